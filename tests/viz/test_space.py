"""Maps in space, of any shape and from any side: what stands around them keeps clear of each other."""

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from itertools import combinations, product

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from teamslam.geometry import Pose
from teamslam.model import Kind, Values, is_pose
from teamslam.viz import Scene, draw_map
from teamslam.viz.sides import SIDES
from teamslam.viz.style import saved

SHAPES = {"tall": (0.5, 0.3, 4.0), "flat": (1.0, 1.0, 0.02), "long": (6.0, 1.0, 1.0), "deep": (0.6, 6.0, 1.0)}
AXES = ("x [m]", "y [m]", "z [m]")


def stretched(scene: Scene, shares: tuple[float, float, float]) -> Scene:
    """The same team in a world that is longer along each axis."""
    values = scene.map.values
    poses, marks = values.layout.keys[is_pose(values.layout.keys)], scene.map.landmark_keys
    found, points = values.poses_of(poses, 3), values.positions(marks, 3)
    longer = Pose(found.rotation, found.translation * shares)
    grown = Values.of({Kind.POSE3: (poses, longer), Kind.POINT3: (marks, points * np.array(shares))})
    return replace(scene, map=replace(scene.map, values=grown), truth=None, caption="a line\nand another")


def words(figure: Figure) -> Iterator[tuple[str, Bbox]]:
    """The title, the caption, the legend, the names of the axes and the numbers at them: where each is drawn."""
    saved(figure, BytesIO())
    pen = figure.canvas.get_renderer()
    (axes,) = figure.axes
    yield "the legend", figure.legends[0].get_window_extent(pen)
    for text in (*figure.texts, axes.xaxis.label, axes.yaxis.label, axes.zaxis.label):
        if text.get_visible() and text.get_text():
            yield text.get_text(), text.get_window_extent(pen)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        low, high = sorted(axis.get_view_interval())
        shown = (tick for tick in axis.majorTicks if low <= tick.get_loc() <= high and tick.label1.get_text())
        yield from ((f"number {n.label1.get_text()}", n.label1.get_window_extent(pen)) for n in shown)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("side", [None, *SIDES])
def test_words_around_a_map_in_space_keep_clear_of_each_other(scene_of, shape: str, side: str | None) -> None:
    figure = draw_map(stretched(scene_of(3), SHAPES[shape]), SIDES[side] if side else None)
    stand = list(words(figure))
    numbers = [part for part in stand if part[0].startswith("number")]
    others = [part for part in stand if part not in numbers]
    around = [part for part in others if part[0] not in AXES]
    for (one, here), (other, there) in (*combinations(others, 2), *product(around, numbers)):
        assert not here.overlaps(there), (one, other)
    for word, box in stand:
        assert figure.bbox.contains(box.x0, box.y0) and figure.bbox.contains(box.x1, box.y1), word
