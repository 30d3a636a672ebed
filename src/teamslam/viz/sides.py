"""From where a map in space is looked at."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam.errors import InputError

ALONG = 0.98  # of a unit vector: from there on an axis points at the eye


@dataclass(frozen=True)
class Side:
    """The direction of the eye: `azimuth` about z, from x over y, and `elevation` above the plane, in degrees."""

    azimuth: float
    elevation: float


SIDES = {
    "top": Side(-90.0, 90.0),
    "front": Side(-90.0, 0.0),
    "back": Side(90.0, 0.0),
    "left": Side(180.0, 0.0),
    "right": Side(0.0, 0.0),
    "corner": Side(-60.0, 30.0),
}


def side_of(word: str) -> Side:
    """A side by its name, or two angles in degrees: '30,20'. InputError names what there is."""
    if word in SIDES:
        return SIDES[word]
    try:
        azimuth, elevation = map(float, word.split(","))
    except ValueError:
        raise InputError(
            f"no side '{word}'; choose {', '.join(SIDES)}, or an azimuth and an elevation in degrees: 30,20"
        ) from None
    if not (-360.0 <= azimuth <= 360.0 and -90.0 <= elevation <= 90.0):
        raise InputError(f"azimuths go from -360 to 360 degrees and elevations from -90 to 90, found {word}")
    return Side(azimuth, elevation)


def turned(axes: Any, side: Side | None) -> None:
    """Look at 3D axes from a side (None: as matplotlib does); from straight in front or above without perspective. An
    axis that points at the eye is left out."""
    if side is None:
        return
    axes.view_init(elev=side.elevation, azim=side.azimuth)
    if side.elevation in (0.0, 90.0, -90.0):
        axes.set_proj_type("ortho")
    up, around = np.radians(side.elevation), np.radians(side.azimuth)
    eye = np.abs([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye.tolist(), strict=True):
        if share > ALONG:
            axis.set_ticks([])
            axis.label.set_visible(False)
        elif eye.max() > ALONG:
            axis.labelpad = 16.0 if eye[2] > ALONG else 34.0  # a low box draws its labels in
