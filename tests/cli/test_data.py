"""`teamslam data unpack`: what an archive holds comes out to the bit, or nothing does; sets are told by their files."""

import bz2
import gzip
import io
import json
import lzma
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

FILES = {"set/a.txt": b"alpha\n" * 400, "set/deep/b.bin": bytes(range(256)) * 40, "set/empty": b""}


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def tarred(path: Path, files: dict[str, bytes], links: dict[str, str] | None = None) -> Path:
    with tarfile.open(path, f"w:{path.suffix[1:] if path.suffix != '.tar' else ''}") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
        for name, target in (links or {}).items():
            entry = tarfile.TarInfo(name)
            entry.type, entry.linkname = tarfile.SYMTYPE, target
            archive.addfile(entry)
    return path


WAYS: dict[str, Callable[[Path, dict[str, bytes]], Path]] = {
    "a.zip": zipped,
    "a.tar": tarred,
    "a.tar.gz": tarred,
    "a.tar.bz2": tarred,
    "a.tar.xz": tarred,
}


@pytest.mark.parametrize("name", WAYS)
def test_what_was_packed_comes_out(teamslam, tmp_path: Path, name: str) -> None:
    archive, out = WAYS[name](tmp_path / name, FILES), tmp_path / "out"
    assert teamslam("data", "unpack", archive, "--out", out).code == 0
    assert {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()} == FILES


@pytest.mark.parametrize(("ending", "pack"), [("bz2", bz2.compress), ("gz", gzip.compress), ("xz", lzma.compress)])
def test_single_files_and_those_packed_within_are_undone(teamslam, tmp_path: Path, ending: str, pack) -> None:
    alone = tmp_path / f"log.csv.{ending}"
    alone.write_bytes(pack(b"1,2\n"))
    within = zipped(tmp_path / "a.zip", {f"tests/one.bag.{ending}": pack(b"bag")})
    assert teamslam("data", "unpack", alone, "--out", tmp_path / "one").code == 0
    assert teamslam("data", "unpack", within, "--out", tmp_path / "two").code == 0
    assert (tmp_path / "one" / "log.csv").read_bytes() == b"1,2\n"
    assert (tmp_path / "two" / "tests" / "one.bag").read_bytes() == b"bag"


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_of_an_archive_cut_off_nothing_is_written(teamslam, tmp_path: Path, name: str, share: float) -> None:
    archive = WAYS[name](tmp_path / name, {"a": bytes(range(256)) * 200, "b": b"x" * 5000})
    whole = archive.read_bytes()
    archive.write_bytes(whole[: int(share * len(whole))])
    called = teamslam("data", "unpack", archive, "--out", tmp_path / "out")
    assert called.code == 2 and called.err.startswith("teamslam:") and called.err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("evil", ["../out.txt", "/tmp/teamslam-evil", "a/../../out.txt", "C:\\evil", "..\\out"])
def test_nothing_is_written_outside_the_folder(teamslam, tmp_path: Path, evil: str) -> None:
    for archive in (zipped(tmp_path / "a.zip", {evil: b"x"}), tarred(tmp_path / "a.tar", {evil: b"x"})):
        called = teamslam("data", "unpack", archive, "--out", tmp_path / "inner" / "out")
        assert called.code == 2 and "outside" in called.err
        assert not list((tmp_path / "inner").rglob("*")) and not Path("/tmp/teamslam-evil").exists()


def test_links_are_what_they_lead_to_within_the_archive(teamslam, tmp_path: Path) -> None:
    inside = tarred(tmp_path / "in.tar", {"x/a": b"a"}, {"y/b": "../x/a"})
    assert teamslam("data", "unpack", inside, "--out", tmp_path / "out").code == 0
    assert (tmp_path / "out/y/b").read_bytes() == b"a" and not (tmp_path / "out/y/b").is_symlink()
    for target in ("/etc/passwd", "../../etc/passwd", "b"):
        outside = tarred(tmp_path / "away.tar", {"x/a": b"a"}, {"b": target})
        assert teamslam("data", "unpack", outside, "--out", tmp_path / "never").code == 2
        assert not (tmp_path / "never").exists()


def test_what_is_there_stays(teamslam, tmp_path: Path) -> None:
    archive, out = zipped(tmp_path / "a.zip", FILES), tmp_path / "out"
    out.mkdir()
    (out / "mine").write_text("mine")
    called = teamslam("data", "unpack", archive, "--out", out)
    assert called.code == 2 and "there already" in called.err
    assert [p.name for p in out.iterdir()] == ["mine"]


def test_a_set_is_known_by_its_files_wherever_they_lie(teamslam, data, tmp_path: Path) -> None:
    """As it was measured with; with a file changed; with one missing; and the next command runs."""
    folder = data("distributed_mapper_4robots")
    files = {f"whole-main/data/robots/{path.name}": path.read_bytes() for path in sorted(folder.iterdir())}
    first, *_ = files
    for name, content, word, code in (
        ("same", files, "same", 0),
        ("other", files | {first: files[first] + b"\n"}, "differ", 1),
        ("fewer", {name: text for name, text in files.items() if name != first}, "missing", 1),
    ):
        archive = zipped(tmp_path / f"{name}.zip", content)
        called = teamslam("data", "unpack", archive, "--out", tmp_path / name, "--json")
        (found,) = json.loads(called.out)["sets"]
        assert called.code == code and found["name"] == "four_robots" and found[word]
        assert [len(found[w]) for w in ("same", "differ", "missing")] == [4 - code, word == "differ", word == "missing"]
    command = found["next"][0].split()
    assert command[:2] == ["teamslam", "run"] and Path(command[2]) == tmp_path / "fewer/whole-main/data/robots"
    same = command[2].replace("fewer", "same")
    assert teamslam("run", same, "--out", tmp_path / "map", "--no-figures").code == 0


def test_what_is_no_set_but_a_log_is_named(teamslam, tmp_path: Path) -> None:
    graph = b"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    archive = zipped(tmp_path / "a.zip", {"some/where/graph.g2o": graph})
    called = teamslam("data", "unpack", archive, "--out", tmp_path / "out")
    assert called.code == 0 and f"next: teamslam info {tmp_path / 'out/some/where'}" in called.out
