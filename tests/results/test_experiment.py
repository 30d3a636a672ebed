"""The figures of the paper's experiment, of recordings: drawn for what there is, and of the right images."""

import numpy as np
import pytest

from teamslam.cli.app import called
from teamslam.results.experiment import views_of
from teamslam.viz import View, draw_positions, draw_views

pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    options = ["--seconds", "8", "--images-hz", "1", "--quiet"]
    assert called(["film", str(folder / "film"), *options]) == 0
    assert called(["run", str(folder / "film" / "team.toml"), "--out", str(folder / "map"), "--quiet"]) in (0, 1, 3)
    return folder


def test_a_run_of_a_film_has_the_figures_of_the_paper(lab):
    for number in (5, 6, 7):
        assert (lab / "map" / "figures" / f"figure_{number}.png").stat().st_size > 10_000


def test_each_camera_shows_its_richest_image(lab):
    import teamslam as ts
    from teamslam.io.bags.team_file import read_team_file
    from teamslam.results.reprojection import reprojected

    team = read_team_file(lab / "film" / "team.toml")
    maps = ts.read_run(lab / "map").maps
    found = reprojected(ts.read(lab / "film" / "team.toml"), maps, team, lab / "film")
    views = views_of(found, team, lab / "film")
    assert [heading.split(",")[0] for heading in views] == [one.robot for one in found]
    for one, view in zip(found, views.values(), strict=True):
        count = np.unique(one.ticks, return_counts=True)[1]
        assert view.image.shape == (480, 640) and len(view.tags) + 0.5 * len(view.tags) >= count.max()
        for corners in view.corners:  # a tag's middle is darker than the white around it
            inside = corners.mean(0).astype(int)
            around = (corners.mean(0) + 1.15 * (corners - corners.mean(0))).round().astype(int)
            near = view.image[inside[1] - 2 : inside[1] + 3, inside[0] - 2 : inside[0] + 3]
            assert near.size and view.image[around[:, 1].clip(0, 479), around[:, 0].clip(0, 639)].max() > near.min()


def test_what_is_not_there_is_not_drawn(lab):
    from teamslam.errors import InputError

    with pytest.raises(InputError, match="no image"):
        draw_views({})
    figure = draw_views({"a": View(np.zeros((4, 6), np.uint8), np.zeros((0, 4, 2)), (), ())})
    assert len(figure.axes[0].images) == 1
    import teamslam as ts
    from teamslam.results.figures import scene_of

    record = ts.read_run(lab / "map")
    scene = scene_of(record, 0)
    drawn = draw_positions(scene)
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert "landmark, truth" in labels
    assert sum(label.endswith(", truth") for label in labels) == len(scene.robots) + 1
