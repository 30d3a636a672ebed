"""A scene: all that a map figure draws, and the sizes that follow from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import WORLD, Submap, Values, region_of, robot_of

CONFIDENCE = 0.95
FACTORS = (100, 50, 20, 10, 5, 2)  # how many times regions too small to see are drawn larger


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a map figure draws.

    `map`: the estimate. `covariances`: marginal covariance of a variable by key, in the frame of the map, any subset.
    `truth`: values in the frame of the map, any subset. `sightings` (n, 2): pairs of pose keys, observer and observed.
    `method` as in the options; `caption`: a line of figures under the title. `second`: where else landmarks could be.
    `weak`: places (n, d) of the part that the map's weakest direction moves, and how one sigma of it moves them.
    """

    map: Submap
    covariances: Mapping[int, Array] = field(default_factory=dict)
    truth: Values | None = None
    sightings: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    method: str = "join"
    title: str = ""
    caption: str = ""
    second: Mapping[int, Array] = field(default_factory=dict)
    weak: tuple[Array, Array] | None = None

    @property
    def robots(self) -> tuple[int, ...]:
        """Robots with a pose in the map, in order."""
        return self.map.robots_in_it

    @property
    def is_spatial(self) -> bool:
        """True where some robot leaves the plane: a plan view would hide its height."""
        values, keys = self.map.all_values, self.map.keys
        heights = values.positions(keys[robot_of(keys) > 0], 3)[:, 2]
        return bool(np.ptp(heights) > 1e-9) if len(heights) else False

    def path(self, robot: int, dim: int) -> Array:
        """The robot's way (n, dim) [m]."""
        return self.map.all_values.positions(self.map.trajectory_keys(robot), dim)

    def true_path(self, robot: int, dim: int) -> Array:
        """The robot's true way (n, dim) [m]; empty where nobody knows it."""
        if self.truth is None:
            return np.zeros((0, dim))
        keys = self.map.trajectory_keys(robot)
        return self.truth.positions(keys[self.truth.layout.contains(keys)], dim)

    def visible_sightings(self, most: int) -> tuple[IntArray, int]:
        """Every n-th sighting whose two poses are in the map, at most `most`, and n."""
        known = self.sightings[self.map.all_values.layout.contains(self.sightings).all(-1)]
        step = max(1, -(-len(known) // most))
        return known[::step], step

    def regions(self, keys: IntArray, dim: int) -> tuple[Array, Array]:
        """Centres (n, dim) and position covariances (n, dim, dim) of the variables whose covariance is known."""
        values = self.map.all_values
        known = np.array([key for key in keys.tolist() if key in self.covariances], np.int64)
        blocks = np.zeros((len(known), dim, dim))
        dims = np.minimum(2 + values.layout.kinds[values.layout.index(known)] % 2, dim)
        for block, key, d in zip(blocks, known.tolist(), dims.tolist(), strict=True):
            block[:d, :d] = self.covariances[key][:d, :d]
        return values.positions(known, dim), blocks

    def has_regions(self, dim: int) -> bool:
        """Whether any region is drawn: of landmarks, and seen from above of the robots' starts too."""
        starts = [] if dim > 2 else [self.map.trajectory_keys(robot)[0] for robot in self.robots]
        return any(int(key) in self.covariances for key in (*self.map.landmark_keys, *starts))

    def second_places(self, keys: IntArray) -> Array:
        """Where landmarks (n,) could be as well (n, 3), nan where there is no such place."""
        found = np.full((len(keys), 3), np.nan)
        for n, key in enumerate(keys.tolist()):
            if key in self.second:
                found[n] = np.pad(self.second[key], (0, 3 - len(self.second[key])))
        return found

    def weakest(self, dim: int) -> tuple[Array, int]:
        """Lines (n, 2, dim) from one sigma of the weakest direction to the other side, and how many times longer than
        they are, for the eye to find them."""
        if self.weak is None:
            return np.zeros((0, 2, dim)), 1
        places, moved = (np.pad(part, ((0, 0), (0, 1)))[:, :dim] for part in self.weak)
        longest = float(np.linalg.norm(moved, axis=-1).max(initial=0.0))
        times = next((k for k in FACTORS if 0.0 < k * longest <= 0.04 * self.extent(dim)), 1)
        return np.stack([places - times * moved, places + times * moved], 1), times

    def extent(self, dim: int) -> float:
        """The longest side of the map [m]."""
        keys = self.map.keys[self.map.keys > WORLD]
        places = self.map.all_values.positions(keys, dim)
        return float(np.ptp(places, axis=0).max()) or 1.0

    def magnification(self, dim: int) -> int:
        """How many times larger regions are drawn so that the eye finds them; the legend says so."""
        radii, _ = shape_of(self.regions(self.map.landmark_keys, dim)[1])
        large = float(np.quantile(radii[:, -1], 0.9)) if len(radii) else 0.0
        most = 0.04 * self.extent(dim)
        return next((k for k in FACTORS if 0.0 < k * large <= most), 1)


def shape_of(covariance: Array, confidence: float = CONFIDENCE) -> tuple[Array, Array]:
    """Radii (..., d) [m], rising, and axes (..., d, d), in columns, of the region drawn of a Gaussian."""
    return region_of(covariance, confidence)
