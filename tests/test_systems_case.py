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
    """A constant force stands for a tilt, with a target or without, and not for whatever else was planted."""
    accept = ["wind", "mass", "joint_damping[elbow]"]
    assert is_right(["wind"], ["floor_tilt"], accept)
    assert not is_right(["wind"], ["friction"], accept)
    assert is_right(["friction", "wind"], ["floor_tilt", "friction"], accept)
    assert not is_right(["mass", "wind"], ["floor_tilt", "friction"], accept)
    assert is_right(["joint_damping[elbow]"], ["servo_damping[elbow]"], accept)
    assert not is_right(["joint_damping[elbow]"], ["backlash[elbow]"], accept)
