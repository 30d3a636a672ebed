"""What a run of recordings writes for robots: the same tags in every file, as another reader has them."""

import csv
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tagged_room

YAML = pytest.importorskip("ruamel.yaml").YAML


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A room that is mapped, two of its tags a landmark together, and the truth of the others."""
    from teamslam.cli.app import called

    folder = tmp_path_factory.mktemp("room")
    room = tagged_room.make(seed=2, seconds=12.0, rate=2.0)
    team = tagged_room.write(room, folder)
    more = []
    for number, (R, T) in room.walls.items():
        x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
        more.append(f"[[truth]]\nnumber = {number}\nxyz_m = {T.tolist()}\nquaternion_wxyz = {[w, x, y, z]}\n")
    text = team.read_text().replace("[tags]\n", "[tags]\nsizes_m = { 999 = 0.3 }\n", 1)
    pair = "[[landmark]]\nname = 'door'\n" + "".join(
        f"[[landmark.tag]]\nnumber = {n}\nxyz_m = {T.tolist()}\n"
        f"rotation_vector = {Rotation.from_matrix(R).as_rotvec().tolist()}\n"
        for n, (R, T) in list(room.walls.items())[1:3]
    )
    team.write_text(text + pair + "".join(more))
    assert called(["run", str(team), "--out", str(folder / "map"), "--no-figures", "--quiet"]) in (0, 1, 3)
    return room, folder / "map"


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_file_holds_the_same_tags(run):
    room, out = run
    rows = rows_of(out / "tags" / "tags.csv")
    poses = {
        int(r["tag"]): (
            np.array([float(r[k]) for k in ("x_m", "y_m", "z_m")]),
            Rotation.from_quat([float(r[k]) for k in ("qx", "qy", "qz", "qw")]).as_matrix(),
        )
        for r in rows
    }
    door = sorted(list(room.walls)[1:3])
    assert {int(r["tag"]) for r in rows if r["landmark"] == "door"} == set(door) and len(poses) >= 5
    assert {float(r["size_m"]) for r in rows} == {tagged_room.SIZE}

    tagslam = YAML(typ="safe").load((out / "tags" / "tagslam.yaml").read_text())
    for tag in tagslam["bodies"][0]["map"]["tags"]:
        place, turn = (np.array([tag["pose"][k][a] for a in "xyz"]) for k in ("position", "rotation"))
        assert np.allclose(place, poses[tag["id"]][0]) and tag["size"] == tagged_room.SIZE
        assert np.allclose(Rotation.from_rotvec(turn).as_matrix(), poses[tag["id"]][1], atol=1e-9)
        assert all(0.0 < tag["pose"][k][a] < 0.5 for k in ("position_noise", "rotation_noise") for a in "xyz")

    bundles = {
        b["name"]: b["layout"]
        for b in YAML(typ="safe").load((out / "tags" / "bundles.yaml").read_text())["tag_bundles"]
    }
    assert set(bundles) == {"map", "robot0", "robot1", "door"}
    for tag in bundles["map"]:
        assert np.allclose([tag[a] for a in "xyz"], poses[tag["id"]][0])
        turn = Rotation.from_quat([tag[k] for k in ("qx", "qy", "qz", "qw")]).as_matrix()
        assert np.allclose(turn, poses[tag["id"]][1], atol=1e-9)

    field = json.loads((out / "tags" / "wpilib.json").read_text())
    assert {t["ID"] for t in field["tags"]} == set(poses) == {t["id"] for t in tagslam["bodies"][0]["map"]["tags"]}


def test_the_tags_of_a_body_lie_as_the_team_file_says(run):
    room, out = run
    rows = {int(r["tag"]): r for r in rows_of(out / "tags" / "tags.csv")}
    one, two = list(room.walls)[1:3]
    away = np.linalg.norm([float(rows[one][k]) - float(rows[two][k]) for k in ("x_m", "y_m", "z_m")])
    assert away == pytest.approx(np.linalg.norm(room.walls[one][1] - room.walls[two][1]), abs=1e-6)


def test_table_3_has_all_three_methods(run):
    _, out = run
    rows = rows_of(out / "table_3.csv")
    found = {(r["method"], r["what"]): float(r["position_rmse_m"]) for r in rows if r["component"] == "1"}
    assert {method for method, _ in found} == {"full", "join", "exact"}
    assert all(found[method, "landmarks"] < 0.1 for method in ("full", "join", "exact"))
    assert found["exact", "landmarks"] == pytest.approx(found["full", "landmarks"], rel=1e-3)


def test_reprojection_is_of_every_camera_and_tag(run):
    room, out = run
    rows = rows_of(out / "tags" / "reprojection.csv")
    assert {r["robot"] for r in rows} == {"robot0", "robot1"}
    cubes = {number for robot in tagged_room.CUBES for number in robot}
    seen = {int(r["tag"]) for r in rows}
    assert seen <= set(room.walls) | cubes and seen & cubes and len(seen & set(room.walls)) >= 5
    pixels = np.concatenate([[float(r["rms_px"])] * int(r["images"]) for r in rows])
    noise = tagged_room.FLOOR * np.sqrt(2.0)  # of a corner, and more where tags are small; less what is fitted
    assert 0.5 * noise < np.median(pixels) < 2.0 * noise
