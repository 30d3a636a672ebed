"""What is none of the formats is told by what was seen of it, with what is missing and what to do."""

from pathlib import Path

import pytest

from teamslam.errors import InputError
from teamslam.io import FORMATS, formats_of, read, read_submaps, write
from worlds import team


def files(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("x\n")
    return folder


FOLDERS = {
    "MRCLAM without barcodes": (
        ["Robot1_Odometry.dat", "Robot1_Measurement.dat"],
        r"looks like MRCLAM \(Robot1_Measurement.dat, Robot1_Odometry.dat\), but has no Barcodes.dat",
    ),
    "MRCLAM without odometry": (["Barcodes.dat"], "but has no Robot1_Odometry.dat"),
    "a simulated run without speeds": (
        ["sensor_data.mat"],
        "looks like a simulated run of I-SLSJF .*, but has no store_speed.mat and no store_turnrate.mat",
    ),
    "tables without team.toml": (
        ["odometry.csv", "landmarks.csv"],
        "looks like teamslam's plain format .*has no team.toml",
    ),
    "a run": (["report.json", "maps/1.x"], "a run of teamslam, which is no log; `teamslam convert` turns its map"),
    "nothing": ([], "the folder is empty"),
    "something else": (
        ["a.pdf", "b.pdf", "c.pdf", "d.pdf", "e.pdf"],
        r"a folder with a.pdf, b.pdf, c.pdf, d.pdf and 1 more",
    ),
}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_that_is_none(name: str, tmp_path: Path) -> None:
    content, expected = FOLDERS[name]
    with pytest.raises(InputError, match=rf"(?s){expected}.*none of the formats.*mrclam"):
        read(files(tmp_path, *content))


FILES = {
    "a packed log": ("team.tar.xz", b"\xfd7zXZ\x00\x00", r"compressed \(xz\): unpack it with xz -d"),
    "a zip": ("team.zip", b"PK\x03\x04", "a zip archive: unpack it, and give the folder"),
    "a bag": ("log.bag.active", b"#ROSBAG V2.0\n", "a ROS bag: .*not closed.*which `rosbag reindex` makes"),
    "mcap": ("log", b"\x89MCAP0\r\n", "a recording in MCAP: where its name ends in .mcap"),
    "zstd": ("log.mcap.zstd", b"\x28\xb5\x2f\xfd\0", "compressed \\(zstd\\): unpack it with unzstd"),
    "a database": ("log.db3", b"SQLite format 3\x00", "a database"),
    "a table alone": (
        "odometry.csv",
        b"t,x,y\n",
        "does not say who measured what: put it into a folder with a team.toml",
    ),
    "words": ("notes.txt", b"dear robot,\nhow are you\n", "begins with 'dear robot, how are you'"),
    "bytes": ("x.bin", b"\x01\x00\x02", "the file is binary"),
    "nothing": ("x.txt", b"", "the file is empty"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_none(name: str, tmp_path: Path) -> None:
    file, content, expected = FILES[name]
    (tmp_path / file).write_bytes(content)
    for reader in (read, read_submaps):
        with pytest.raises(InputError, match=rf"(?s){expected}.*none of the formats"):
            reader(tmp_path / file)


@pytest.mark.parametrize("name", ["team.toml", "truth_robots.csv"])
def test_a_part_of_a_log_points_to_its_folder(name: str, tmp_path: Path) -> None:
    write(team("2d", poses=4), tmp_path / "log", "plain")
    with pytest.raises(InputError, match=rf"a part of teamslam's plain format; give the folder {tmp_path / 'log'}"):
        read(tmp_path / "log" / name)


def test_a_folder_around_a_log_points_to_it(tmp_path: Path) -> None:
    write(team("2d", poses=4), tmp_path / "unpacked" / "log", "plain")
    with pytest.raises(InputError, match="the folder is none, but log in it is; give that"):
        read(tmp_path / "unpacked")
    write(team("2d", poses=4), tmp_path / "other" / "team.pyfg", "pyfg")
    with pytest.raises(InputError, match=r"the folder is none, but team\.pyfg in it is; give that"):
        read(tmp_path / "other")


def test_submaps_are_no_log(tmp_path: Path) -> None:
    (tmp_path / "localmap_1.txt").write_text("0\n0\n")
    with pytest.raises(InputError, match=r"this is Linear SLAM: a folder with localmap_1\.txt"):
        read(tmp_path)


def test_a_log_says_what_it_looks_like(tmp_path: Path) -> None:
    log = team("2d", poses=4)
    for name in ("plain", "g2o", "pyfg"):
        path = tmp_path / f"log{FORMATS[name].suffixes[0] if FORMATS[name].suffixes else ''}"
        write(log, path, name)
        assert ("log", name) in formats_of(path)
