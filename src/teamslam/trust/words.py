"""A verdict in words."""

import math
from collections.abc import Iterator

from teamslam.trust.cause import rows_called
from teamslam.trust.fit import Verdict, far_by_its_join

MOST = 2  # words on outliers in one sentence
MATTERS = 0.02  # of the cost: what full least squares of the rows as they are would not cost


def sentence(found: Verdict) -> str:
    """The verdict in words, with the figures it rests on."""
    if found.level == "unknown":
        return f"unknown: {found.reason}"
    times, (low, high) = found.cost / found.expected, (end / found.expected for end in found.band)
    figures = f"the cost is {_number(times)} times what is expected ({low:.2f} to {high:.2f} by chance)"
    if found.decrease > MATTERS * found.cost:
        why = (
            "since rows count by how their errors hang together" if found.weighed else "by the join's own approximation"
        )
        figures += f", {_number(found.decrease / found.expected)} of that {why}"
    return f"{_judged(found, times)}: {figures}{''.join(_outliers(found))}"


def _judged(found: Verdict, times: float) -> str:
    if found.level == "loose":
        return f"the standard deviations look too large, about {_number(1.0 / math.sqrt(max(times, 1e-12)))} times"
    if far_by_its_join(found):
        return "the join is far from the optimum of its measurements (`--exact` or `--method full` may reach it)"
    return {"fits": "the model fits", "strained": "the model fits poorly", "misfit": "THE MODEL DOES NOT FIT"}[
        found.level
    ]


def _outliers(found: Verdict) -> Iterator[str]:
    """Words on the sensors with the most outliers, where the verdict is not worse than they are."""
    many = [n for n in found.noise if n.has_outliers and not found.gross]
    for n in sorted(many, key=lambda n: -n.outliers)[:MOST]:
        who = found.names.robot(n.robot)
        yield f"; {n.outliers:.0%} of robot {who}'s {rows_called(n.source)} are outliers in {n.part}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.2g}" if value < 0.1 or value >= 10.0 else f"{value:.2f}"
