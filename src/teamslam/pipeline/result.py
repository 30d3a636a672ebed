"""A finished run: what went in, what came out, and how far it is to be believed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from teamslam.answers import Answers, ResidualTable
from teamslam.answers.maps_card import facts_of, maps_card
from teamslam.config import Config
from teamslam.joining import Cost, Joined
from teamslam.metrics import Late, Report
from teamslam.model import Dataset, Submap, Values
from teamslam.solver import Covariances
from teamslam.trust import Assessment, Cause, Decisions, Suspicions, Verdict, sentence
from teamslam.trust.calibration import Calibration
from teamslam.trust.unknowns import Settled


@dataclass(frozen=True, eq=False)
class Result(Answers):
    """A finished run, asked by name (see `teamslam.answers`): what went in, what came out, seconds of each stage.

    `map` is the first component: the one of the lowest robot. `covariances`, `costs` and `scores` have those of each;
    a cost is None where the raw measurements are not at hand, and `scores` is empty where no truth is known. `submaps`
    is empty for full least squares. `trust` says how far the map is to be believed, `decisions` which sightings were
    wrong and left out, where that was asked for; `calibration` what was wrong with the model of the data, and was put
    right; it is false where nothing was, None where the noise was taken as stated. `unknowns` is what the log rests on
    and nobody measured, clocks and cameras, and what was found of it; None where there is nothing uncertain.
    `truth_late` is by how much the truth of robots was late, and was matched so. `apart` are the landmarks that were
    moved, or of which two carry one name: each is two in the map and in `dataset`; and those that one robot's sightings
    name wrongly beyond doubt: they are called otherwise there; and sensors that sit elsewhere than stated, which
    `unknowns` has as they were found.
    """

    config: Config
    dataset: Dataset
    submaps: tuple[Submap, ...]
    joined: Joined
    covariances: tuple[Covariances, ...]
    costs: tuple[Cost | None, ...]
    trust: Assessment
    scores: tuple[Report, ...]
    seconds: dict[str, float]
    decisions: Decisions | None = None
    calibration: Calibration | None = None
    unknowns: Settled | None = None
    truth_late: Mapping[int, Late] = field(default_factory=dict)
    apart: tuple[Cause, ...] = ()

    @property
    def map(self) -> Submap:
        """The joined map."""
        return self.joined.map

    @property
    def verdict(self) -> Verdict:
        """How well the map fits."""
        return self.trust.verdict

    @property
    def suspicions(self) -> Suspicions | None:
        """Which names and robots are not to be believed, put right where that was asked for; None where nobody looked
        (full least squares, exact joins, workers)."""
        return self.trust.suspicions

    @property
    def maps(self) -> tuple[Submap, ...]:
        """One for each component."""
        return self.joined.maps

    @property
    def truth(self) -> Values | None:
        """What the log knows of the truth."""
        return self.dataset.truth

    def residuals(self) -> ResidualTable:
        """How far every row of the log is off at the maps."""
        return self.joined.residuals()

    def __repr__(self) -> str:
        return f"Result({'; '.join(value for _, value in self._facts())}; {sentence(self.verdict)})"

    def _repr_html_(self) -> str:
        scores = [(f"errors{_part(n, self.scores)}", found.headline) for n, found in enumerate(self.scores, 1)]
        facts = [*self._facts(), *scores, ("took", f"{sum(self.seconds.values()):.1f} s")]
        return maps_card(self.dataset.origin or "A team's map", self, facts, sentence(self.verdict))

    def _facts(self) -> list[tuple[str, str]]:
        return [*facts_of(self), ("state", "converged" if self.joined.converged else "not converged")]


def _part(number: int, of: Sequence[object]) -> str:
    return f", part {number}" if len(of) > 1 else ""
