"""Figures say what they show, draw without a display, and leave matplotlib as it was."""

import io
import subprocess
import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from scipy.stats import chi2

from teamslam.errors import InputError
from teamslam.model import Values
from teamslam.viz import (
    ErrorTrack,
    ResidualTrack,
    Scene,
    draw_consistency,
    draw_convergence,
    draw_errors,
    draw_map,
    draw_maps,
    draw_residuals,
    draw_residuals_by_landmark,
)
from teamslam.viz.frame import log_scale
from teamslam.viz.residuals import dots
from teamslam.viz.space import region_wires
from teamslam.viz.style import COLUMNS, NARROW, saved, seen, style


def texts(figure: Figure) -> str:
    """Everything written on a figure."""
    figure.canvas.draw()
    return "\n".join(t.get_text() for t in figure.findobj(matplotlib.text.Text))


def image(figure: Figure) -> bytes:
    """The figure as a picture."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=60)
    return buffer.getvalue()


def tracks(dof: int = 3) -> list[ErrorTrack]:
    """Two robots with errors of their stated size."""
    rng = np.random.default_rng(5)
    sigma = np.full((50, dof), 0.1)
    error = sigma * rng.standard_normal((50, dof))
    nees = np.mean((error / sigma) ** 2, -1)
    labels, units = ("x", "y", "z", "rx", "ry", "rz")[:dof], ("m", "m", "m", "rad", "rad", "rad")[:dof]
    return [ErrorTrack(name, np.arange(50.0), error, sigma, nees, labels, units) for name in ("1", "b")]


DRAWS = """
import hashlib, sys
from teamslam.viz.style import ready, saved
if len(sys.argv) > 1:
    ready()
import io
import matplotlib.artist, numpy as np
from teamslam.viz import ErrorTrack, draw_errors
t = np.arange(50.0)
figure = draw_errors([ErrorTrack("1", t, np.sin(t)[:, None] * [1, 2, 3], np.ones((50, 3)), t / 50)])
figure.axes[0].lines[0].set(lw=3.0, alpha=0.5)
saved(figure, file := io.BytesIO())
class Own(matplotlib.artist.Artist):
    pass
print(hashlib.sha256(file.getvalue()).hexdigest(), "zorder" in Own.set.__doc__)
"""


def test_who_is_ready_beforehand_draws_the_same() -> None:
    """What matplotlib writes of its own classes for readers is left out, and nothing else."""
    plain, ready = (
        subprocess.run([sys.executable, "-c", DRAWS, *more], capture_output=True, text=True, check=True).stdout
        for more in ([], ["ready"])
    )
    assert plain == ready
    assert "True" in plain


def test_a_map_says_what_it_shows(scene: Scene) -> None:
    """Method, figures, robots by name, units, truth and regions are all named on it."""
    written = texts(draw_map(scene))
    for word in ("submap joining", "position RMSE 0.12 m", "robot b", "x [m]", "y [m]", "truth", "95% region", "end"):
        assert word in written


@pytest.mark.parametrize("dim", [2, 3])
def test_the_weakest_direction_is_drawn_to_both_sides_where_there_is_one(scene_of, dim: int) -> None:
    """As lines about the places that it moves, all longer by one number that the legend tells."""
    scene = scene_of(dim)
    assert "weakest" not in texts(draw_map(scene))
    places = scene.map.all_values.positions(scene.map.trajectory_keys(2)[::5], dim)
    moved = np.full_like(places, 0.01)
    weak = replace(scene, weak=(places, moved))
    lines, times = weak.weakest(dim)
    np.testing.assert_allclose(lines.mean(1), places, atol=1e-12)
    np.testing.assert_allclose(lines[:, 1] - lines[:, 0], 2 * times * moved, atol=1e-12)
    assert f"weakest, ± 1 sigma,\ndrawn {times} times longer" in texts(draw_map(weak)) and times > 1


def test_a_map_without_truth_or_covariances_does_not_claim_them(scene: Scene) -> None:
    """Nothing is named that is not drawn."""
    bare = Scene(scene.map, method="full")
    written = texts(draw_map(bare))
    assert "true path" not in written and "region" not in written and "sightings" not in written
    assert "full least squares" in written and "in the frame of robot 1" in written


def test_ellipses_stand_where_the_estimate_is_and_have_the_size_of_the_covariance(scene_of) -> None:
    """A region for each landmark and each start but the base's, enlarged by the factor that the legend tells."""
    scene = scene_of(2)
    figure = draw_map(scene)
    FigureCanvasAgg(figure).draw()
    axes = figure.axes[0]
    drawn = [part for c in axes.collections if isinstance(c, EllipseCollection) for part in outlines(c, axes)]
    starts = [scene.map.trajectory_keys(robot)[0] for robot in scene.robots]
    keys = [int(key) for key in (*scene.map.landmark_keys, *starts) if key != scene.map.base]
    assert len(drawn) == len(keys) == 5 + 2
    for key in keys:
        place = scene.map.all_values.positions(np.array(key), 2)
        mine = min(drawn, key=lambda outline, place=place: np.linalg.norm(outline.mean(0) - place))
        off = (mine - place) / scene.magnification(2)
        squared = np.einsum("ni,ij,nj->n", off, np.linalg.inv(scene.covariances[key][:2, :2]), off)
        np.testing.assert_allclose(squared, -2.0 * np.log(0.05), rtol=2e-3)


def outlines(regions: EllipseCollection, axes: Axes) -> list[np.ndarray]:
    """The ellipses of a collection as they are drawn, as points in the units of the axes."""
    turn = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], -1)
    assert regions.get_paths()[0].get_extents().size == pytest.approx([2.0, 2.0])
    places = regions.get_offset_transform().transform(regions.get_offsets())
    back = axes.transData.inverted()
    shape = regions.get_transform()
    return [
        back.transform(place + shape.transform(circle @ each[:2, :2].T + each[:2, 2]))
        for place, each in zip(places, regions.get_transforms(), strict=True)
    ]


@pytest.mark.parametrize("landmarks", [5, 300])
def test_wires_in_space_lie_on_the_surfaces_of_the_regions(landmarks: int) -> None:
    """Of few landmarks and of many."""
    rng = np.random.default_rng(landmarks)
    centres, root = rng.normal(0.0, 10.0, (landmarks, 3)), rng.normal(0.0, 1.0, (landmarks, 3, 3))
    covariances = root @ np.swapaxes(root, -1, -2)
    wires = region_wires(centres, covariances, 2.0).reshape(landmarks, -1, 3)
    assert np.isnan(wires[:, -1]).all()  # lines of one region do not run to the next
    off = (wires - centres[:, None]) / 2.0
    squared = np.einsum("nki,nij,nkj->nk", off, np.linalg.inv(covariances), off)
    np.testing.assert_allclose(squared[np.isfinite(squared)], chi2.ppf(0.95, 3), rtol=1e-6)
    assert np.isfinite(squared).sum(1).min() >= 75


def test_several_maps_stand_side_by_side_each_with_its_title_and_one_legend(scene_of) -> None:
    """Three panels need two rows; each says how much its own regions are enlarged."""
    scenes = {"near": scene_of(2), "sure": scene_of(2, sd=0.003), "far": scene_of(2, 60)}
    figure = draw_maps(scenes, "Three maps")
    written = texts(figure)
    for word in ("Three maps", "near", "sure", "far", "times larger", "landmark, truth"):
        assert word in written
    assert sum(axes.get_visible() for axes in figure.axes) == 3 and len(figure.axes) == 4
    with pytest.raises(InputError, match="no map"):
        draw_maps({}, "nothing")


def test_what_stands_above_each_of_several_maps_is_its_own_and_as_wide(scene_of) -> None:
    """Thinned sightings and enlarged regions are said where they hold; the legend names each kind once."""
    scene = replace(scene_of(2, 900, sd=0.003), caption="a sentence of many words that would not fit above it " * 2)
    figure = draw_maps({"many": scene, "few": scene_of(2, 60)}, "Two maps")
    figure.canvas.draw()
    many, few = figure.axes
    assert "1 in 3 sightings of robots drawn" in many.get_title(loc="left")
    assert "sightings" not in few.get_title(loc="left")
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len({label.split("\n")[0].rstrip(",") for label in named}) == len(named)
    above = next(
        t for t in many.get_children() if getattr(t, "get_text", str)() == many.get_title(loc="left")
    ).get_window_extent()
    assert above.x1 < few.get_tightbbox().x0
    assert figure.get_tightbbox().x1 <= figure.get_size_inches()[0] + 0.02


def test_the_same_scene_gives_the_same_picture(scene: Scene) -> None:
    """Figures carry no chance and no date."""
    assert image(draw_map(scene)) == image(draw_map(scene))


def test_drawing_leaves_the_settings_of_matplotlib_alone(scene: Scene) -> None:
    """Whoever calls keeps their own style, and nothing is registered with pyplot."""
    before = dict(matplotlib.rcParams)
    draw_map(scene)
    draw_convergence({"a log": {"join": [3.0, 1.0]}})
    assert dict(matplotlib.rcParams) == before


def test_convergence_names_each_line_with_its_final_objective() -> None:
    """The last cost stands in the legend."""
    written = texts(draw_convergence({"a log": {"join": [100.0, 7.5, 7.25], "full": [90.0, 7.0]}}))
    assert "join: 7.25" in written and "full: 7" in written and "iteration" in written and "a log" in written


@pytest.mark.parametrize("dof", [2, 3])
def test_errors_tell_the_share_within_three_sigma(dof: int) -> None:
    """One column a robot, one row a coordinate, units on the axes."""
    figure = draw_errors(tracks(dof), caption="RMSE 0.1 m")
    written = texts(figure)
    assert len(figure.axes) == 2 * dof
    assert (
        "robot b: 100.0% within" in written
        and "x [m]" in written
        and "time since the start [s]" in written
        and "RMSE" in written
    )


@pytest.mark.parametrize("size", [1e-2, 4e4, 1e8])
def test_objectives_that_hardly_fall_are_written_in_full(size: float) -> None:
    """Nothing is to be added to the ticks, or multiplied with: that would stand on the heading."""
    figure = draw_convergence({"the cost": {"full least squares": size * np.array([1.00001, 1.0, 1.0])}})
    figure.canvas.draw()
    (axes,) = figure.axes
    assert axes.yaxis.get_offset_text().get_text() == ""
    shown = [float(tick.get_text().replace("\N{MINUS SIGN}", "-")) for tick in axes.get_yticklabels()]
    assert any(size <= value <= 1.00001 * size for value in shown)


def test_headings_of_the_plane_stand_beside_turns_about_z() -> None:
    """A robot of the plane and one of space: six rows, and each column is labelled below its last."""
    flat, deep = (tracks(dof)[k] for k, dof in enumerate((3, 6)))
    flat = replace(flat, labels=("x", "y", "heading"), units=("m", "m", "rad"))
    figure = draw_errors([deep, flat])
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(figure.axes) == 12 and len(shown) == 9
    below = [axes for axes in shown if axes.get_xlabel()]
    assert len(below) == 2 and len({axes.get_position().y0 for axes in below}) == 1
    assert "heading" not in texts(figure)


def test_consistency_shows_the_bound_and_each_robots_mean() -> None:
    """Means near 1 for errors of the stated size."""
    written = texts(draw_consistency(tracks()))
    mean = float(tracks()[0].nees.mean())
    assert f"b: {mean:.2f}" in written and "95% bound" in written


@pytest.mark.parametrize("draw", [lambda: draw_convergence({}), lambda: draw_errors([]), lambda: draw_consistency([])])
def test_nothing_to_draw_is_an_error_that_says_why(draw) -> None:
    """An empty figure would look like a result."""
    with pytest.raises(InputError, match="to draw"):
        draw()


def left(robots: int = 2, landmarks: int = 3, rows: int = 60) -> list[ResidualTrack]:
    """Residuals of unit size: odometry and sightings of landmarks by robots called 'robot-0', ..."""
    rng = np.random.default_rng(8)
    found = []
    for number in range(robots):
        for source, targets in (("odometry", ["robot"]), ("landmarks", [f"landmark {n}" for n in range(landmarks)])):
            size = np.abs(rng.standard_normal(rows)) * (1 + number)
            at = rng.integers(0, len(targets), rows)
            found.append(
                ResidualTrack(f"robot-{number}", source, np.arange(rows, dtype=float), size, at, tuple(targets))
            )
    return found


def test_residuals_are_drawn_by_robot_and_sensor() -> None:
    """Every robot and every sensor by name; what is not drawn is said; stamps that nobody knows are no matter."""
    written = texts(draw_residuals(left(), caption="a team"))
    for word in ("robot-0", "robot-1", "odometry", "landmarks", "a team", "sigma"):
        assert word in written
    many = texts(draw_residuals(left(robots=12)))
    assert "8 of 12 robots whose residuals are largest" in many and "robot-11" in many and "robot-0" not in many
    timeless = [replace(track, stamps_s=np.full(60, np.nan)) for track in left(1)]
    assert image(draw_residuals(timeless))


def test_few_residuals_are_seen_as_well_as_many() -> None:
    """The fewer dots, the larger and darker each; never the other way, and bounded."""
    looks = [dots(count) for count in (1, 10, 100, 1_000, 1_500)]
    for name, least, most in (("ms", 2.0, 5.0), ("alpha", 0.35, 0.8)):
        found = [look[name] for look in looks]
        assert found == sorted(found, reverse=True) and found[0] == most and found[-1] == pytest.approx(least)
    with pytest.raises(InputError):
        draw_residuals([])


def test_residuals_are_drawn_by_landmark() -> None:
    """The worst first, each robot's by its name."""
    tracks = [track for track in left() if track.source == "landmarks"]
    figure = draw_residuals_by_landmark(tracks)
    written = texts(figure)
    for word in ("robot robot-0", "robot robot-1", "landmark", "0", "1", "2"):
        assert word in written
    medians = [np.median(np.concatenate([t.size[t.target == n] for t in tracks])) for n in range(3)]
    labels = [int(label.get_text()) for label in figure.axes[0].get_xticklabels()]
    assert labels == np.argsort(-np.array(medians)).tolist()
    many = [track for track in left(1, landmarks=60, rows=600) if track.source == "landmarks"]
    assert "40 of 60 landmarks whose residuals are largest" in texts(draw_residuals_by_landmark(many))
    with pytest.raises(InputError):
        draw_residuals_by_landmark([])


@settings(max_examples=60)
@given(
    st.sampled_from([COLUMNS, NARROW]),
    st.floats(4.01, 6.0),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.01, 1.0]),
)
def test_of_a_long_curve_all_that_an_eye_can_see_is_drawn(
    columns: int, times: float, seed: int, unknown: float
) -> None:
    """The first and last stamps, and in every stretch the lowest and highest value; nothing else."""
    rng, count = np.random.default_rng(seed), int(times * columns)
    x = np.sort(rng.choice([rng.uniform(0.0, 1e6, count), np.arange(count) * 0.1]))
    y = np.where(rng.uniform(size=count) < unknown, np.nan, rng.normal(size=count))
    few_x, few_y = seen(x, y, columns)
    assert len(few_x) <= 2 * columns
    place = np.searchsorted(x, few_x)
    assert (np.diff(few_x) >= 0.0).all() and (x[place] == few_x).all()
    column = np.minimum((x - x[0]) * (columns / (x[-1] - x[0])), columns - 1).astype(int)
    few_column = np.minimum((few_x - x[0]) * (columns / (x[-1] - x[0])), columns - 1).astype(int)
    for stretch in rng.choice(np.unique(column), 20):
        mine, drawn = y[column == stretch], few_y[few_column == stretch]
        assert np.isnan(drawn).any() or np.nanmin(drawn) == mine.min()
        known = mine[np.isfinite(mine)]
        assert not len(known) or np.nanmax(drawn) == known.max()


def test_a_short_curve_is_drawn_as_it_is() -> None:
    x = np.arange(4.0 * COLUMNS)
    assert seen(x, x)[0] is x
    assert seen(np.zeros(10 * COLUMNS), np.zeros(10 * COLUMNS))[0].size == 10 * COLUMNS


@settings(max_examples=40, deadline=None)
@given(st.floats(-12.0, 12.0), st.floats(np.log10(3.0), 9.0))
def test_a_logarithmic_scale_has_labels_that_say_the_values_of_their_ticks(low: float, decades: float) -> None:
    """In plain letters, whatever it spans."""
    axes = Figure().add_subplot()
    log_scale(axes)
    axes.plot([0, 1], [10.0**low, 10.0 ** (low + decades)])
    image(axes.figure)
    ticks = [*axes.yaxis.get_major_ticks(), *axes.yaxis.get_minor_ticks()]
    limits = axes.get_ylim()
    said = {t.get_loc(): t.label1.get_text() for t in ticks if limits[0] <= t.get_loc() <= limits[1]}
    labels = {value: text for value, text in said.items() if text}
    assert labels
    if np.log10(limits[1] / limits[0]) < 1.99:
        assert labels == said  # a tick without its number is no scale
    letters = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    for value, text in labels.items():
        times, _, power = text.rpartition("10")
        assert float(times.rstrip("×") or 1.0) * 10.0 ** int(power.translate(letters)) == pytest.approx(value)


@pytest.mark.parametrize("size", [1e-7, 1e-3, 1.0, 1e3, 1e7])
@pytest.mark.parametrize("robots", [1, 8])
def test_nothing_stands_outside_a_figure(scene_of, size: float, robots: int) -> None:
    """Numbers of any size, long names, long captions."""
    rng = np.random.default_rng(0)
    many = [
        ErrorTrack(f"tractor {k} of mine", np.arange(50.0) * size, size * rng.normal(size=(50, 3)),
                   np.full((50, 3), size), size * rng.chisquare(3, 50))
        for k in range(robots)
    ]  # fmt: skip
    scene = scene_of(2)
    values = scene.map.values
    grown = Values(values.layout, np.where(np.abs(values.state) > 1.0, size * values.state, values.state))
    caption = "a line of words\nand another"
    figures = [
        draw_errors(many, caption=caption), draw_consistency(many, caption=caption),
        draw_map(replace(scene, map=replace(scene.map, values=grown), covariances={}, truth=None, caption=caption)),
        draw_residuals(left(robots), caption=caption),
        draw_residuals_by_landmark([replace(t, targets=("door of the north wing",) * 3) for t in left(robots)[1::2]]),
    ]  # fmt: skip
    for figure in figures:
        figure.canvas.draw()
        box = figure.get_tightbbox()
        width, height = figure.get_size_inches()
        assert box.x0 >= -0.02 and box.y0 >= -0.02 and box.x1 <= width + 0.02 and box.y1 <= height + 0.02


def test_a_picture_is_what_matplotlib_saves(scene: Scene) -> None:
    """Dot by dot, without the channel that is full everywhere."""
    from matplotlib.image import imread

    figure, ours, theirs = draw_map(scene), io.BytesIO(), io.BytesIO()
    saved(figure, ours)
    with style():
        figure.savefig(theirs, format="png")
    ours.seek(0), theirs.seek(0)
    whole = imread(theirs)
    np.testing.assert_array_equal(imread(ours), whole[..., :3])
    assert (whole[..., 3] == 1.0).all()


def test_a_picture_is_as_large_as_its_figure(scene: Scene) -> None:
    """In dots per inch as asked for."""
    from matplotlib.image import imread

    figure = draw_map(scene)
    for dpi in (None, 50):
        file = io.BytesIO()
        saved(figure, file, dpi=dpi)
        file.seek(0)
        height, width, _ = imread(file).shape
        assert (width, height) == pytest.approx(figure.get_size_inches() * (dpi or 160), abs=1.0)


def test_a_picture_says_its_size(scene: Scene) -> None:
    """Its dots per inch stand in the file, for who prints it."""
    from PIL import Image

    file = io.BytesIO()
    saved(draw_map(scene), file, dpi=90)
    file.seek(0)
    with Image.open(file) as read:
        assert read.info["dpi"] == pytest.approx((90, 90), abs=0.02)


@pytest.mark.parametrize("dofs", [(3, 3), (3, 2), (2, 3)])
def test_panels_have_the_lines_of_the_ticks_outermost(dofs: tuple[int, int]) -> None:
    """A panel without ticks of its own has lines where the one has them that shares its axis and is named; and every
    row and column that is used has its numbers."""
    figure = draw_errors([tracks(dof)[k] for k, dof in enumerate(dofs)])
    figure.canvas.draw()
    grid = np.array(figure.axes).reshape(-1, 2)
    used = [[axes for axes in line if axes.axison] for line in (*grid, *grid.T)]
    rows, columns = used[: len(grid)], used[len(grid) :]
    for name, other, line, named in [("y", 1, row, row[0]) for row in rows] + [("x", 0, c, c[-1]) for c in columns]:
        axis = getattr(named, f"{name}axis")
        low, high = sorted(axis.get_view_interval())
        ticks = [at for at in axis.get_majorticklocs() if low <= at <= high]
        assert axis.get_visible() and any(label.get_text() for label in axis.get_ticklabels())
        for axes in line:
            if axes is not named:
                assert not getattr(axes, f"{name}axis").get_visible()
                drawn = [s for c in axes.collections if isinstance(c, LineCollection) for s in c.get_segments()]
                lines = [s[0, other] for s in drawn if s[0, other] == s[1, other]]
                np.testing.assert_allclose(lines, ticks)
