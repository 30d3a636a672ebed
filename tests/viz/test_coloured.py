"""Maps coloured by a number carry the numbers that they say, from the side that is asked for; runs stand beside each
other."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from teamslam.errors import InputError
from teamslam.viz import (
    SIDES,
    ErrorCloud,
    Scene,
    Side,
    draw_comparison,
    draw_error_map,
    draw_map,
    draw_residual_map,
    side_of,
)


def drawn(figure: Figure) -> str:
    """All that is written on a figure once it is drawn."""
    FigureCanvasAgg(figure).draw()
    return "\n".join(text.get_text() for axes in figure.axes for text in axes.findobj() if hasattr(text, "get_text"))


def test_ways_are_coloured_by_their_distance_from_the_truth(scene: Scene) -> None:
    """Each piece by the larger of the errors at its ends; landmarks by their own; the bar says what it is."""
    assert scene.truth is not None
    figure = draw_error_map(scene)
    assert "distance from the truth [m]" in drawn(figure)
    lines = [c for c in figure.axes[0].collections if isinstance(c, LineCollection | Line3DCollection)]
    for robot, line in zip(scene.robots, lines, strict=True):
        keys = scene.map.trajectory_keys(robot)
        off = scene.map.all_values.positions(keys, 3) - scene.truth.positions(keys, 3)
        far = np.linalg.norm(off, axis=-1)
        np.testing.assert_allclose(line.get_array(), np.maximum(far[:-1], far[1:]))
    marks = scene.map.all_values.positions(scene.map.landmark_keys, 3)
    marks = np.linalg.norm(marks - scene.truth.positions(scene.map.landmark_keys, 3), axis=-1)
    dots = [c for c in figure.axes[0].collections if isinstance(c, PathCollection) and c.get_array() is not None]
    np.testing.assert_allclose(np.sort(dots[-1].get_array()), np.sort(marks))


def test_without_a_truth_there_is_nothing_to_colour(scene_of) -> None:
    with pytest.raises(InputError, match="the truth of nothing"):
        draw_error_map(scene_of(2, truth=False))


def test_residuals_are_drawn_where_they_were_taken(scene: Scene) -> None:
    """Medians by place and by landmark; the sightings that leave more than three sigmas as lines, and counted."""
    rng = np.random.default_rng(2)
    keys = scene.map.trajectory_keys(1)
    places = np.repeat(scene.map.all_values.positions(keys, 3), 5, axis=0)
    targets = np.tile(np.arange(-1, 4), len(keys))
    sizes = rng.uniform(0.5, 1.5, len(places))
    sizes[[6, 8]] = 7.0  # sightings of landmarks 0 and 2
    written = drawn(figure := draw_residual_map(scene, places, sizes, targets))
    assert "lines: the 2 sightings" in written and "median size of residuals [sigma]" in written
    dots = [c.get_array() for c in figure.axes[0].collections if isinstance(c, PathCollection)]
    medians = [np.median(sizes[targets == n]) for n in range(4)]
    (of_marks,) = (np.sort(values) for values in dots if values is not None and len(values) == 4)
    np.testing.assert_allclose(of_marks, np.sort(medians))
    assert "no sighting of a landmark leaves" in drawn(
        draw_residual_map(scene, places, np.minimum(sizes, 2.0), targets)
    )
    with pytest.raises(InputError, match="no residuals"):
        draw_residual_map(scene, places[:0], sizes[:0], targets[:0])


@pytest.mark.parametrize("name", SIDES)
def test_sides(scene: Scene, name: str) -> None:
    """A map is looked at from there, also one of a plane."""
    axes = draw_map(scene, side_of(name)).axes[0]
    assert (axes.azim, axes.elev) == (SIDES[name].azimuth, SIDES[name].elevation)


def test_sides_are_words_or_angles() -> None:
    assert side_of("30,-20") == Side(30.0, -20.0)
    for wrong in ("behind", "30", "30,100", "a,b", "nan,1"):
        with pytest.raises(InputError, match=r"side|degrees"):
            side_of(wrong)


def test_runs_beside_each_other() -> None:
    """A line a run that reaches 1 at its worst error; a box for each robot and for landmarks, of each run."""
    rng = np.random.default_rng(4)
    clouds = {
        run: ErrorCloud({robot: scale * rng.exponential(size=60) for robot in ("a", "b$")}, rng.exponential(size=5))
        for run, scale in (("one", 1.0), ("two", 0.5))
    }
    figure = draw_comparison(clouds, caption="from the truth")
    written = drawn(figure)
    assert "robot b" in written and "landmarks" in written and "from the truth" in written
    shares, boxes = figure.axes
    for line, cloud in zip(shares.lines, clouds.values(), strict=True):
        assert line.get_xdata()[-1] == cloud.every.max() and line.get_ydata()[-1] == 1.0
    assert len(boxes.patches) == 2 * 3
    with pytest.raises(InputError, match="nothing to compare"):
        draw_comparison({"one": ErrorCloud({}, np.zeros(0))})
