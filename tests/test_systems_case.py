"""What is known of all kinds of systems together: which effects no recording of any of them tells apart."""

from __future__ import annotations

from runner.diagnosis.score import is_right
from runner.effects import mechanism, planar_box
from runner.systems.case import always_confounded


def test_confounded_pairs_are_those_of_every_kind() -> None:
    """Of the box and of mechanisms, each pair once, and both of its names are effects of one kind."""
    pairs = always_confounded()
    assert {"mass", "actuator_gain"} in pairs
    assert {"joint_damping", "servo_damping"} in pairs
    kinds = set(planar_box.EFFECTS), {cls.name for cls in mechanism.EFFECTS}
    for pair in pairs:
        assert len(pair) == 2
        assert any(pair <= names for names in kinds)
    for kind in kinds:
        assert any(pair <= kind for pair in pairs)


def test_an_accepted_name_counts_for_its_own_twin_only() -> None:
    """Of several effects a constant force stands for a tilt, and not for whatever else was planted beside it.

    Of one effect all that the list accepts counts: it says so of nothing else.
    """
    accept = ["wind", "mass", "joint_damping[elbow]"]
    assert is_right(["wind"], ["floor_tilt"], accept)
    assert is_right(["wind"], ["friction"], accept)
    assert not is_right(["stribeck"], ["friction"], accept)
    assert is_right(["friction", "wind"], ["floor_tilt", "friction"], accept)
    assert not is_right(["mass", "wind"], ["floor_tilt", "friction"], accept)
    damped = ["friction", "joint_damping[elbow]"]
    assert is_right(damped, ["servo_damping[elbow]", "friction"], accept)
    assert not is_right(damped, ["backlash[elbow]", "friction"], accept)
