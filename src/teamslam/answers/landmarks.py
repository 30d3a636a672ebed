"""Landmarks by name: where they are, how sure that is, how tags are turned."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.answers.columns import AXES, Columns, Tabular, covariance_columns, place_columns
from teamslam.answers.maps import Maps, found_in, frame_of
from teamslam.errors import ModelError, in_words
from teamslam.geometry import Array, IntArray, Pose, Sealed, seal
from teamslam.model import Asked, Kind, Submap, index_of, landmark_asked, nearest, region_of


@dataclass(frozen=True, eq=False)
class Landmark(Sealed):
    """One landmark: `position` (d,) [m] and its `covariance` (d, d) in the frame of the map; `pose`, where its
    orientation was measured (a tag). `component` is its map, counted from 1."""

    name: str
    position: Array
    covariance: Array
    pose: Pose | None
    frame: str
    component: int = 1

    def __post_init__(self) -> None:
        seal(self, "position", "covariance")

    def __repr__(self) -> str:
        return f"Landmark({self})"

    def __str__(self) -> str:
        place = ", ".join(f"{axis} {value:.3f}" for axis, value in zip(AXES, self.position.tolist(), strict=False))
        radii, _ = self.region()
        return f"{in_words(self.name)}: {place} m; 95 % within {' x '.join(f'{r:.3f}' for r in radii[::-1].tolist())} m"

    @property
    def sigmas(self) -> Array:
        """Standard deviations (d,) [m]."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    def region(self, confidence: float = 0.95) -> tuple[Array, Array]:
        """The ellipse or ellipsoid about `position` that holds the landmark with `confidence`: its half axes (d,) [m],
        rising, and their directions (d, d), in columns."""
        return region_of(self.covariance, confidence)


@dataclass(frozen=True, eq=False)
class Landmarks(Sealed, Tabular):
    """All landmarks of a team: `names` (n), `positions` (n, d) [m], `covariances` (n, d, d), each in the frame of its
    component, `components` (n,), counted from 1. Ones of the plane among those of space lie at height 0.

    `team.landmarks["door"]` is one of them; going through them gives them one by one.
    """

    names: tuple[str, ...]
    positions: Array
    covariances: Array
    components: IntArray
    frames: tuple[str, ...]
    poses: tuple[Pose | None, ...]

    def __post_init__(self) -> None:
        seal(self, "positions", "covariances", "components")

    def __repr__(self) -> str:
        some = ", ".join(map(in_words, self.names[:6])) + (", ..." if len(self) > 6 else "")
        return f"Landmarks({len(self):,}: {some})"

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[Landmark]:
        return (self._at(place) for place in range(len(self)))

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: Asked) -> Landmark:
        """The landmark of a name. ModelError, with the names nearest to it, where there is none."""
        if str(name) not in self.names:
            raise ModelError(f"no landmark here is called '{in_words(str(name))}'; {nearest(str(name), self.names)}")
        return self._at(self.names.index(str(name)))

    def _at(self, place: int) -> Landmark:
        component = int(self.components[place])
        where, block = self.positions[place], self.covariances[place]
        return Landmark(self.names[place], where, block, self.poses[place], self.frames[component - 1], component)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)

    def regions(self, confidence: float = 0.95) -> tuple[Array, Array]:
        """Half axes (n, d) [m], rising, and directions (n, d, d), in columns, of the region of each landmark."""
        return region_of(self.covariances, confidence)

    def columns(self) -> Columns:
        """component, landmark, its place and covariance, as landmarks.csv has them."""
        return {
            "component": self.components,
            "landmark": np.array(self.names, object),
            **place_columns(self.positions),
            **covariance_columns(self.covariances, AXES[: self.positions.shape[-1]]),
        }


def landmarks_of(team: Maps) -> Landmarks:
    """All landmarks, map by map in the order of their numbers."""
    dim = max((_dim_of(submap, submap.landmark_keys) for submap in team.maps), default=2)
    names: list[str] = []
    places, blocks, components, poses = [], [], [], []
    for number, (submap, known) in enumerate(zip(team.maps, team.covariances, strict=True), start=1):
        keys, layout = submap.landmark_keys, submap.all_values.layout
        kinds = layout.kinds[layout.index(keys)]
        names += [submap.names.landmark(n) for n in index_of(keys).tolist()]
        places.append(submap.all_values.positions(keys, dim))
        blocks.append(_place_blocks(known.blocks(keys), kinds, dim))
        components.append(np.full(len(keys), number))
        poses += [_pose_of(submap, key) for key in keys.tolist()]
    return Landmarks(
        tuple(names),
        np.concatenate(places),
        np.concatenate(blocks),
        np.concatenate(components),
        tuple(map(frame_of, team.maps)),
        tuple(poses),
    )


def landmark_of(team: Maps, name: Asked, component: int | None) -> Landmark:
    """One landmark, of its own dimension. ModelError in words where there is none, or one in several maps."""
    number, (key,) = found_in(team, [name], landmark_asked, component)
    submap, known = team.maps[number - 1], team.covariances[number - 1]
    dim = _dim_of(submap, np.array([key]))
    return Landmark(
        submap.names.landmark(int(index_of(key))),
        submap.all_values.positions(np.array(key), dim),
        known.of(key)[:dim, :dim],
        _pose_of(submap, key),
        frame_of(submap),
        number,
    )


def _dim_of(submap: Submap, keys: IntArray) -> int:
    """3 where one of the variables is in space."""
    layout = submap.all_values.layout
    return int(2 + (layout.kinds[layout.index(keys)] % 2).max(initial=0))


def _pose_of(submap: Submap, key: int) -> Pose | None:
    """The pose of a landmark that is one."""
    layout = submap.all_values.layout
    return submap.all_values.pose(key) if layout.kinds[layout.index(key)] < Kind.POINT2 else None


def _place_blocks(blocks: Sequence[Array], kinds: IntArray, dim: int) -> Array:
    """The covariances (n, dim, dim) of where things are; those of the plane among those of space do not rise."""
    out = np.zeros((len(blocks), dim, dim))
    for place, block in enumerate(blocks):
        own = int(2 + kinds[place] % 2)
        out[place, :own, :own] = block[:own, :own]
    return out
