"""How much an explanation leaves of episodes that it has not seen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from runner.inference.doubts import needed
from runner.inference.foretold import astray, usually_left
from runner.inference.held_out import Confirmed

COUNT = 100


def losses(*squared_noises: float) -> Any:
    """A fit of episodes that leaves so much beyond the noise in each."""
    loss = tuple(COUNT * (1.0 + s) for s in squared_noises)
    return SimpleNamespace(
        episodes=tuple(range(len(squared_noises))),
        loss=loss,
        total=sum(loss),
        of=lambda kept: losses(*(squared_noises[k] for k in kept)),
    )


FITTER: Any = SimpleNamespace(measured=SimpleNamespace(excess=lambda loss, _: loss / COUNT - 1.0))


def confirmed(before: Any, after: Any, fitted: float = 0.0) -> Confirmed:
    gap, left = (sum(f.loss) / COUNT / len(f.loss) - 1.0 for f in (before, after))
    none: Any = None
    return Confirmed(none, none, {}, 0.0, 0.0, gap, left, fitted, usually_left(before, after, FITTER))


def test_it_is_the_geometric_mean_over_episodes_in_which_there_is_a_gap() -> None:
    """sqrt(1/10 x 4/2); an episode at rest says nothing."""
    assert usually_left(losses(10, 2, 0.0), losses(1, 4, 0.2), FITTER) == pytest.approx((0.1 * 2) ** 0.5)


def test_one_episode_that_hangs_on_a_hair_is_not_failing() -> None:
    """What foretells one to the noise and is as far away as ever in the other, by far the larger, does not fail."""
    assert not confirmed(losses(8.7, 24.0), losses(0.2, 33.0)).fails


def test_what_foretells_none_fails() -> None:
    """Nor does it help to foretell what had no gap."""
    assert confirmed(losses(8.0, 24.0, 0.1), losses(7.0, 20.0, 0.0)).fails
    assert confirmed(losses(2.0, 3.0), losses(4.0, 2.9)).fails


def test_episodes_in_which_the_effect_hardly_acts_say_nothing_of_it() -> None:
    """A rough floor leaves 1.5 squared noises of any episode: 2.1 of one whose gap is 1.6 is that floor."""
    assert confirmed(losses(0.0, 1.6), losses(0.0, 2.1)).fails
    assert not confirmed(losses(0.0, 1.6), losses(0.0, 2.1), fitted=1.5).fails
    assert confirmed(losses(0.0, 9.0), losses(0.0, 8.0), fitted=1.5).fails


def test_what_foretells_all_by_most_does_not() -> None:
    """As before: by squares it closes most of the gap."""
    assert not confirmed(losses(20.0, 1.2), losses(2.0, 2.4)).fails


def test_an_episode_that_nothing_foretells_is_set_aside_where_the_others_are_foretold() -> None:
    """A machine was touched in the last of four stretches; two explanations hold in the others."""
    before, after = losses(150, 330, 200, 17000), [losses(20, 17, 9, 22000), losses(30, 20, 9, 15000)]
    assert astray(before, after, FITTER, fitted=12) == (3,)


def test_none_is_set_aside_where_an_explanation_foretells_all_or_none_holds_elsewhere() -> None:
    before = losses(150, 330, 200, 17000)
    assert astray(before, [losses(20, 17, 9, 22000), losses(70, 150, 90, 100)], FITTER, fitted=12) == ()
    assert astray(before, [losses(120, 310, 190, 22000)], FITTER, fitted=12) == ()
    assert astray(before, [], FITTER, fitted=12) == ()


def test_where_there_is_nothing_to_foretell_elsewhere_none_is_set_aside() -> None:
    """A limit that one push of all reaches: it is all that there is to be explained."""
    assert astray(losses(0.1, 0.0, 0.2, 204), [losses(0.1, 0.0, 0.1, 203)], FITTER, fitted=7) == ()


def test_what_comes_near_it_by_chance_does_not_foretell_it() -> None:
    """Another explanation, off by most elsewhere, leaves less of the part that is astray."""
    before, after = losses(150, 330, 200, 17000), [losses(20, 17, 9, 22000), losses(140, 300, 190, 4000)]
    assert astray(before, after, FITTER, fitted=12) == (3,)


def test_many_episodes_are_not_set_aside() -> None:
    """Two of four, or one of three in all: it is the explanations that are wrong."""
    assert astray(losses(150, 330, 200, 170), [losses(20, 17, 199, 168)], FITTER, fitted=4) == ()
    assert astray(losses(150, 330), [losses(1, 329)], FITTER, fitted=1) == ()


def contender(names: str, total: float) -> Any:
    """An explanation by the letters of its effects, and what it leaves."""
    fit = SimpleNamespace(explanation=SimpleNamespace(candidates=tuple(names)))
    return SimpleNamespace(fit=fit, evidence=SimpleNamespace(left=total))


def test_an_effect_is_needed_where_a_plain_gap_is_left_without_it() -> None:
    """With both 1 squared noise is left, without the one 92, without the other 2: the best fewer effects leave."""
    both = contender("ab", 2.0 * COUNT)
    others = [contender("", 107.0 * COUNT), contender("a", 93.0 * COUNT), contender("b", 3.0 * COUNT)]
    assert needed(both, [both, *others], COUNT) == {"b"}


def test_where_much_is_left_anyway_an_effect_is_needed_only_if_many_times_that_is_left_without_it() -> None:
    """A machine's model leaves 500 squared noises: 600 more is nothing plain."""
    both = contender("ab", 501.0 * COUNT)
    others = [contender("", 9000.0 * COUNT), contender("a", 1100.0 * COUNT), contender("b", 6000.0 * COUNT)]
    assert needed(both, [both, *others], COUNT) == {"a"}
    assert needed(both, [both], COUNT) == set()  # what was not tried says nothing
