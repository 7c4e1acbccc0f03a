"""What flights until the first hit say by themselves: no contact has a part in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from runner.inference.contender import Contender, contend
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import Fitter


@dataclass(frozen=True)
class Flown:
    """The likeliest explanation of the flights alone.

    Args:
        fitter: Of the flights; to it each is an episode.
        best: The likeliest, from a search whose fits only begin, or finished.
        noises: The root mean square that it leaves, in noises.
        probability: Its own among what that search has begun to fit, `unknown` counted in.
        all_of_it: Whether nothing was hit before the end of any episode: then flights are all that was recorded.
    """

    fitter: Fitter = field(repr=False)
    best: Contender = field(repr=False)
    noises: float
    probability: float
    all_of_it: bool

    def finished(self) -> Flown:
        """Return it with the best one fitted until it rests, and what that leaves; the probability is as it was."""
        fit = self.best.fit
        if not fit.explanation.candidates:
            return self
        fit = self.fitter.fit(fit.explanation, fit.episodes, x=fit.x, starts=fit.starts)
        around = sensitivities(self.fitter, fit, directions(self.fitter.system))
        best = contend(self.fitter, fit, around, dispersion=self.best.evidence.dispersion)
        return replace(self, best=best, noises=math.sqrt(fit.total / self.fitter.measured.count(fit.episodes)))
