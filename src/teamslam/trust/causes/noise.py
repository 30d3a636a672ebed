"""What of an excess is noise that was stated wrongly, and no mistake in the log: sigmas too small, outliers."""

from collections.abc import Sequence

import numpy as np

from teamslam.model import Names
from teamslam.trust.cause import Cause, rows_called
from teamslam.trust.noise import ONE_IN_1000, Noise
from teamslam.trust.residuals import Rows

TOO_SMALL = 1.5  # times: a sigma that is worth a word
BENT = 3.0  # times: residuals so large that are no noise, which bend the map and the residuals of all others with it
WORTH = 0.1  # of the excess, that must be explained


def noise_causes(noise: Sequence[Noise], rows: Sequence[Rows], excess: float, names: Names) -> list[Cause]:
    """The sigmas and outliers that explain most of what a map costs too much: a sentence for each kind of sensor.
    No sigma is named where residuals keep their sign: there the map is wrong, and not what is said of noise."""
    found: list[Cause] = []
    bent = any(n.scale > BENT and not n.is_noise for n in noise)
    for source in dict.fromkeys(n.source for n in noise):
        here = [n for n in noise if n.source == source]
        small = [(n, _gone(n, rows, n.scale)) for n in here if n.scale > TOO_SMALL and n.is_noise and not bent]
        wild = [(n, _gone(n, rows, None)) for n in here if n.has_outliers]
        if small:
            found.append(_sigma(source, small, excess, names))
        if wild:
            cure = "; a robust loss forgives them" if all(r.table.loss.name == "squared" for r in rows) else ""
            found.append(_outliers(source, wild, excess, names, cure))
    return sorted((c for c in found if c.explains > WORTH), key=lambda cause: -cause.explains)


Parts = Sequence[tuple[Noise, float]]
"""Parts of sensors, each with how much less its rows would cost."""


def _sigma(source: str, small: Parts, excess: float, names: Names) -> Cause:
    said = f"the sigma of {_parts(small)} in {rows_called(source)} by {names.these(_numbers(small))} looks"
    scales = sorted(n.scale for n, _ in small)
    return Cause("sigma", f"{said} {_range(scales, '.1f')} times too small", _share(small, excess), _numbers(small))


def _outliers(source: str, wild: Parts, excess: float, names: Names, cure: str) -> Cause:
    shares = _range(sorted(n.outliers for n, _ in wild), ".0%")
    said = f"{shares} of {rows_called(source)} by {names.these(_numbers(wild))}"
    return Cause("outliers", f"{said} are outliers in {_parts(wild)}{cure}", _share(wild, excess), _numbers(wild))


def _share(parts: Parts, excess: float) -> float:
    return min(sum(gone for _, gone in parts) / excess, 1.0)


def _numbers(parts: Parts) -> tuple[int, ...]:
    return tuple(sorted({n.robot for n, _ in parts}))


def _parts(parts: Parts) -> str:
    words = list(dict.fromkeys(n.part for n, _ in parts))
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _range(values: Sequence[float], form: str) -> str:
    first, last = format(values[0], form), format(values[-1], form)
    return first if first == last else f"{first} to {last}"


def _gone(noise: Noise, rows: Sequence[Rows], scale: float | None) -> float:
    """How much less a sensor's rows would cost with the sigma of a part so many times larger, or, without a scale, with
    its outliers as far off as the usual row."""
    usual, cost = max(noise.scale, 1.0), 0.0
    for r in rows:
        parts = r.table.row.part_names(r.table.dim)
        if (r.table.robot, r.table.source) != (noise.robot, noise.source) or noise.part not in parts:
            continue
        size = r.parts[:, parts.index(noise.part)] ** 2
        outlying = size > (ONE_IN_1000 * usual) ** 2
        less = size / scale**2 if scale is not None else np.where(outlying, usual**2, size)
        cost += float((r.cost - r.table.loss.cost(np.maximum(r.squared - size + less, 0.0))).sum())
    return cost
