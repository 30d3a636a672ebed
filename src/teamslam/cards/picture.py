"""Small pictures in SVG: a plan of ways and places, curves, and lanes of what happened when.

A few kilobytes whatever goes in: of long ways every n-th point is drawn, of many marks every n-th.
"""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from teamslam.errors import in_words

Points = NDArray[np.float64]

# Okabe and Ito (2008), the yellow left out (too pale for thin lines), a grey-violet and a brown added.
ROBOT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6A5ACD", "#8C564B")
MARKS = "#7A1F5C"
WIDTH, HEIGHT, EDGE = 220.0, 160.0, 8.0
MOST_POINTS, MOST_MARKS, MOST_LINES, BINS, LEVELS = 120, 120, 24, 40, 3


def plan(ways: Sequence[Points], marks: Points, regions: Points | None = None) -> str:
    """Ways (n, 2) and marks (m, 2) [m] seen from above, to one scale; `regions` (m, 2, 2): the covariance of each mark,
    drawn as its ellipse of 2.45 sigma, which holds 95 %. Empty where there is nothing to draw."""
    ways = [_thinned(way, MOST_POINTS) for way in ways[:MOST_LINES] if len(way)]
    kept = slice(None, None, max(1, -(-len(marks) // MOST_MARKS)))
    marks = marks[kept]
    everything = np.concatenate([*ways, marks]) if ways or len(marks) else np.zeros((0, 2))
    everything = everything[np.isfinite(everything).all(-1)]
    if not len(everything):
        return ""
    low, high = everything.min(0), everything.max(0)
    scale = float(
        min((WIDTH - 2 * EDGE) / max(high[0] - low[0], 1e-9), (HEIGHT - 2 * EDGE) / max(high[1] - low[1], 1e-9))
    )
    scale = scale if np.isfinite(scale) and scale < 1e6 else 1.0
    middle = 0.5 * (low + high)

    def at(points: Points) -> Points:
        return np.asarray((points - middle) * [scale, -scale] + [WIDTH / 2, HEIGHT / 2])

    parts = [] if regions is None else _ellipses(at(marks), regions[kept] * scale**2)
    parts += [_line(at(way), ROBOT_COLOURS[n % len(ROBOT_COLOURS)]) for n, way in enumerate(ways)]
    parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="{MARKS}"/>' for x, y in at(marks).tolist()]
    return _svg(parts)


def curves(lines: Sequence[tuple[Points, Points]]) -> str:
    """Curves y over x, from zero up, each in the colour of its robot. Empty where there is nothing to draw."""
    lines = [(x, y) for x, y in lines[:MOST_LINES] if len(x)]
    finite = [(x[np.isfinite(y)], y[np.isfinite(y)]) for x, y in lines]
    if not any(len(x) for x, _ in finite):
        return ""
    left, right = min(x.min() for x, _ in finite if len(x)), max(x.max() for x, _ in finite if len(x))
    top = max(y.max() for _, y in finite if len(y)) or 1.0
    parts = []
    for number, (x, y) in enumerate(finite):
        across = EDGE + (x - left) / max(right - left, 1e-12) * (WIDTH - 2 * EDGE)
        up = HEIGHT - EDGE - y / top * (HEIGHT - 2 * EDGE)
        parts.append(_line(_thinned(np.stack([across, up], -1), MOST_POINTS), ROBOT_COLOURS[number % 8]))
    return _svg(parts)


def lanes(times: Mapping[str, Points]) -> str:
    """When things happened (n,), a lane for each name, darker where much did. Empty where nothing did."""
    known = {name: t[np.isfinite(t)] for name, t in list(times.items())[:MOST_LINES]}
    every = np.concatenate([*known.values(), np.zeros(0)])
    if not len(every):
        return ""
    start, stop = every.min(), every.max()
    left, high = 78.0, min(16.0, (HEIGHT - 2 * EDGE) / len(known))
    parts = []
    for place, (name, own) in enumerate(known.items()):
        counts, _ = np.histogram(own, BINS, (start, max(stop, start + 1e-9)))
        top = EDGE + place * high
        wide = (WIDTH - EDGE - left) / BINS
        parts.append(
            f'<text x="{left - 4}" y="{top + 0.7 * high:.1f}" font-size="9" text-anchor="end" fill="currentColor">'
            f"{escape(in_words(name)[:16])}</text>"
        )
        level = np.ceil(LEVELS * counts / counts.max()).astype(int)
        parts += [
            _boxes(np.flatnonzero(level == n), left, wide, top, high, n / LEVELS) for n in set(level.tolist()) - {0}
        ]
    return _svg(parts, EDGE * 2 + high * len(known))


def balance(ratios: Sequence[tuple[str, float]]) -> str:
    """Positive numbers beside 1, on a scale of powers of ten: bars to the right are above 1, bars to the left below.
    Empty where there are none."""
    known = [(name, ratio) for name, ratio in ratios if np.isfinite(ratio) and ratio > 0][:MOST_LINES]
    if not known:
        return ""
    reach = max(1.0, *(abs(np.log10(ratio)) for _, ratio in known))  # a tenth and ten at least
    left, high = 98.0, min(16.0, (HEIGHT - 2 * EDGE) / len(known))
    half = 0.5 * (WIDTH - EDGE - left)
    parts = []
    for place, (name, ratio) in enumerate(known):
        top, long = EDGE + place * high, float(half * np.log10(ratio) / reach)
        parts.append(
            f'<text x="{left - 4}" y="{top + 0.7 * high:.1f}" font-size="9" text-anchor="end" fill="currentColor">'
            f"{escape(in_words(name)[:20])}</text>"
            f'<rect x="{left + half + min(long, 0.0):.1f}" y="{top + 2:.1f}" width="{abs(long):.1f}" '
            f'height="{high - 4:.1f}" fill="{ROBOT_COLOURS[1 if long > 0 else 0]}"/>'
        )
    bottom = EDGE * 2 + high * len(known)
    middle = f"{left + half:.1f}"
    parts.append(f'<line x1="{middle}" y1="2" x2="{middle}" y2="{bottom - 2:.1f}" stroke="currentColor"/>')
    return _svg(parts, bottom)


def _boxes(bins: NDArray[np.int64], left: float, wide: float, top: float, high: float, shade: float) -> str:
    """The bins of a lane that are equally dark, neighbours as one box."""
    runs = np.split(bins, np.flatnonzero(np.diff(bins) > 1) + 1)
    path = "".join(
        f"M{left + wide * run[0]:.0f} {top + 1:.0f}h{wide * len(run):.0f}v{high - 2:.0f}h-{wide * len(run):.0f}z"
        for run in runs
    )
    return f'<path d="{path}" fill="{ROBOT_COLOURS[0]}" fill-opacity="{shade:.2f}"/>'


def _thinned(points: Points, most: int) -> Points:
    """Every n-th point, and the last."""
    step = max(1, -(-len(points) // most))
    return points if step == 1 else np.concatenate([points[::step], points[-1:]])


def _line(points: Points, colour: str) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points[np.isfinite(points).all(-1)].tolist())
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.3"/>'


def _ellipses(centres: Points, covariances: Points) -> list[str]:
    sizes, axes = np.linalg.eigh(covariances)
    radii = 2.4477 * np.sqrt(np.maximum(sizes, 0.0))
    turns = -np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1]))
    return [
        f'<ellipse rx="{major:.1f}" ry="{minor:.1f}" transform="translate({x:.1f} {y:.1f}) rotate({turn:.0f})" '
        f'fill="{MARKS}" fill-opacity=".2" stroke="{MARKS}" stroke-width=".6"/>'
        for (x, y), (minor, major), turn in zip(centres.tolist(), radii.tolist(), turns.tolist(), strict=True)
        if major < 10 * WIDTH
    ]


def _svg(parts: Sequence[str], height: float = HEIGHT) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {WIDTH:.0f} {height:.0f}">{"".join(parts)}</svg>'
    )
