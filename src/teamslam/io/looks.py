"""What a path looks like that is none of the formats: what was seen, what is missing, what to do."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

SHOWN = 4  # names of a folder's content in a message
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp")
LOOKED_AT = 50  # entries of a folder that are looked at whether one of them is a log


@dataclass(frozen=True)
class Family:
    """A format of several files in one folder: what it is called, files that give it away, and those that it needs."""

    name: str
    signs: re.Pattern[str]
    needs: tuple[tuple[str, re.Pattern[str]], ...]


def _named(text: str) -> re.Pattern[str]:
    return re.compile(text, re.IGNORECASE)


FAMILIES = (
    Family(
        "MRCLAM",
        _named(r"robot\d_(odometry|measurement|groundtruth)\.dat|barcodes\.dat|landmark_groundtruth\.dat"),
        (("Barcodes.dat", _named(r"barcodes\.dat")), ("Robot1_Odometry.dat", _named(r"robot\d_odometry\.dat"))),
    ),
    Family(
        "a simulated run of I-SLSJF",
        _named(r"(sensor_data|store_speed|store_turnrate)\.mat"),
        tuple((f"{n}.mat", _named(rf"{n}\.mat")) for n in ("sensor_data", "store_speed", "store_turnrate")),
    ),
    Family("a run of teamslam", _named(r"report\.json|trajectories\.csv|history\.csv"), ()),
    Family("teamslam's plain format", _named(r"team\.toml|.*\.csv"), (("team.toml", _named(r"team\.toml")),)),
)

MAGIC = {
    b"\xfd7zXZ": "compressed (xz): unpack it with xz -d, and then with tar -xf where it is an archive",
    b"\x1f\x8b": "compressed (gzip): unpack it with gunzip, and then with tar -xf where it is an archive",
    b"BZh": "compressed (bzip2): unpack it with bunzip2, and then with tar -xf where it is an archive",
    b"PK\x03\x04": "a zip archive: unpack it, and give the folder",
    b"\x28\xb5\x2f\xfd": "compressed (zstd): unpack it with unzstd",
    b"#ROSBAG": "a ROS bag: where its name ends in .bag, `teamslam info` lists what it holds, and proposes a team "
    "file; one that was not closed (.bag.active) has no index, which `rosbag reindex` makes",
    b"\x89MCAP0": "a recording in MCAP: where its name ends in .mcap, `teamslam info` lists what it holds, and "
    "proposes a team file",
    b"SQLite": "a database: of a ROS 2 recording `teamslam info` lists what it holds, and proposes a team file",
    b"\x89HDF": "an HDF5 file (MATLAB 7.3 among others): save MATLAB data again with '-v7'",
    b"MATLAB": "a MATLAB file; of these, I-SLSJF's logs and local maps are read",
}


def described(path: Path, fits: Callable[[Path], Iterable[str]]) -> str:
    """What a path looks like, in words. `fits` says which formats a path is."""
    return _folder(path, fits) if path.is_dir() else _file(path, fits)


def _folder(path: Path, fits: Callable[[Path], Iterable[str]]) -> str:
    names = sorted(entry.name for entry in path.iterdir() if not entry.name.startswith("."))
    if not names:
        return "the folder is empty"
    if {"report.json", "maps"} <= set(names):
        return "the folder holds a run of teamslam, which is no log; `teamslam convert` turns its map into other files"
    for family in FAMILIES:
        signs = [name for name in names if family.signs.fullmatch(name)]
        missing = [file for file, pattern in family.needs if not any(map(pattern.fullmatch, names))]
        if signs and missing:
            return f"it looks like {family.name} ({_listed(signs)}), but has no {' and no '.join(missing)}"
    inner = [name for name in names[:LOOKED_AT] if next(iter(fits(path / name)), None)]
    if not inner and (shown := [name for name in names if Path(name).suffix.lower() in PICTURES]):
        return f"the folder holds images ({_listed(shown)}){_filmed(path, '*' + Path(shown[0]).suffix)}"
    if inner:
        return f"the folder is none, but {_listed(inner)} in it is; give that"
    return f"found a folder with {_listed(names)}"


def _file(path: Path, fits: Callable[[Path], Iterable[str]]) -> str:
    from teamslam.io.bags.videos import is_video

    with path.open("rb") as file:
        start = file.read(200)
    if not start:
        return "the file is empty"
    for magic, what in MAGIC.items():
        if start.startswith(magic):
            return f"the file is {what}"
    for family in FAMILIES:
        if family.signs.fullmatch(path.name) and next(iter(fits(path.parent)), None):
            return f"the file is a part of {family.name}; give the folder {path.parent}"
    if is_video(path):
        return f"the file is a video{_filmed(path, '*')}"
    if path.suffix == ".csv":
        return "a CSV by itself does not say who measured what: put it into a folder with a team.toml (docs/formats.md)"
    if b"\0" in start:
        return "the file is binary"
    words = start.decode(errors="replace").split()
    return f"the file begins with '{' '.join(words)[:60]}'" if words else "the file begins with blank lines"


def _filmed(path: Path, pattern: str) -> str:
    """How images come into a team file."""
    return (
        f"; tags are looked for in its images where a team file (docs/recordings.md) names it: "
        f"[[robot]] recording = '{path.name}', [[robot.camera]] images = '{pattern}'"
    )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
