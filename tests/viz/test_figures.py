"""Figures say what they show, draw without a display, and leave matplotlib as it was."""

import io
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from teamslam.errors import InputError
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
    labels, units = ("x", "y", "z")[:dof], ("m",) * dof
    return [ErrorTrack(name, np.arange(50.0), error, sigma, nees, labels, units) for name in ("1", "b")]


def test_a_map_says_what_it_shows(scene: Scene) -> None:
    """Method, figures, robots by name, units, truth and regions are all named on it."""
    written = texts(draw_map(scene))
    for word in ("submap joining", "position RMSE 0.12 m", "robot b", "x [m]", "y [m]", "truth", "95% region", "end"):
        assert word in written


def test_a_map_without_truth_or_covariances_does_not_claim_them(scene: Scene) -> None:
    """Nothing is named that is not drawn."""
    bare = Scene(scene.map, method="full")
    written = texts(draw_map(bare))
    assert "true path" not in written and "region" not in written and "sightings" not in written
    assert "full least squares" in written and "in the frame of robot 1" in written


def test_ellipses_stand_where_the_estimate_is_and_have_the_size_of_the_covariance(scene_of) -> None:
    """An outline for each landmark and each start but the base's, enlarged by the factor that the legend tells."""
    scene = scene_of(2)
    outlines = [p for p in draw_map(scene).axes[0].patches if isinstance(p, Ellipse) and p.get_alpha() is None]
    assert len(outlines) == 5 + 2
    key = int(scene.map.landmark_keys[0])
    place = scene.map.all_values.positions(np.array(key), 2)
    mine = next(p for p in outlines if np.allclose(p.center, place))
    area = np.pi * mine.width * mine.height / 4.0 / scene.magnification(2) ** 2
    expected = np.pi * -2.0 * np.log(0.05) * np.sqrt(np.linalg.det(scene.covariances[key][:2, :2]))
    assert area == pytest.approx(expected)


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
