"""In what a truth and a map that are not alike would be: in other units, in a mirror, with headings in degrees.

x_truth  ~  s R x_map + t ,   det R = 1 or -1     (Umeyama 1991), of what both know, seen from above
h_truth  ~  180 / pi h_map                        by Rayleigh's test (Mardia, Jupp, "Directional Statistics", 6.3)
"""

import numpy as np

from teamslam.geometry import Array
from teamslam.metrics.frames import Aligned

FEWEST = 6  # places, and poses
LEFT = 0.01  # of the squared spread, that may be left: a tenth of how large it is
NEAR = 0.1  # of a logarithm: what a unit is told from
UNITS = {"millimetres": 1e3, "centimetres": 1e2, "feet": 1.0 / 0.3048}
SURE = 20.0  # n R^2 of Rayleigh's test: by chance once in 5e8
CLOSE = 0.5  # R


def likeness(aligned: Aligned) -> str:
    """How the truth would be like the map, in words; nothing where it is not, or is as it stands."""
    if aligned.alike:
        return _in_degrees(aligned)
    here, there = (v.positions(aligned.keys, 3)[:, :2] for v in (aligned.estimate, aligned.truth))
    if len(here) < FEWEST:
        return ""
    for mirrored in (False, True):
        scale, left = _similar(here, there, mirrored=mirrored)
        if left < LEFT:
            how = [_in_unit(scale)] if abs(np.log(scale)) > NEAR else []
            how += ["in a mirror, with left and right exchanged in one of them"] if mirrored else []
            return f"it fits {' and '.join(how)}" if how else ""
    return ""


def _similar(here: Array, there: Array, *, mirrored: bool) -> tuple[float, float]:
    """By how much the one is larger than the other where it fits best, and what is left of its squared spread."""
    one, other = here - here.mean(0), there - there.mean(0)
    along = np.linalg.svd(other.T @ one, compute_uv=False)
    straight = np.linalg.det(other.T @ one) > 0.0
    overlap = along[0] + (along[1] if straight != mirrored else -along[1])
    own, spread = float((one**2).sum()), float((other**2).sum())
    return float(overlap / max(own, 1e-300)), 1.0 - float(overlap**2 / max(own * spread, 1e-300))


def _in_unit(scale: float) -> str:
    for unit, factor in UNITS.items():
        if abs(np.log(scale / factor)) < NEAR:
            return f"with its lengths in {unit}, where metres are expected"
    return f"with its lengths {scale:.3g} times as large as those of the map"


def _in_degrees(aligned: Aligned) -> str:
    """Whether headings of the truth look like degrees."""
    keys = aligned.known_poses(aligned.keys)
    if len(keys) < FEWEST:
        return ""
    true, estimate = (poses.xytheta()[:, 2] for poses in aligned.poses(keys))
    if _resultant(estimate - true) > CLOSE:
        return ""
    found = max(_resultant(np.degrees(turned) - true) for turned in (estimate, estimate % (2.0 * np.pi)))
    if len(keys) * found**2 < SURE or found < CLOSE:
        return ""
    return "its headings look like degrees, where radians are expected"


def _resultant(angles: Array) -> float:
    return float(np.abs(np.exp(1j * angles).mean()))
