"""`teamslam team`: a team that drives and exchanges on one machine; the map of all is the offline map."""

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from teamslam.cli.convoy import convoy
from teamslam.convoy import Driver
from teamslam.errors import InputError
from teamslam.events import happened
from teamslam.fleet import Member
from teamslam.io import read, read_submaps, write
from teamslam.joining import build, split
from teamslam.live import replayed
from teamslam.robot import Options, Robot
from teamslam.robot.journal import Journal
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import opened
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.rows import head_of
from teamslam.team import SubmapSet
from teamslam.wire.messages import canonical, send
from worlds import team


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small team's log with truth."""
    path = tmp_path_factory.mktemp("team") / "log"
    write(team("2d", robots=3, poses=24, landmarks=8, sees=0.6), path, "plain")
    return path


def test_over_poor_links_it_is_the_offline_map(teamslam, log: Path, tmp_path: Path) -> None:
    links = ["--loss", 0.3, "--delay", 1.5, "--twice", 0.2, "--line-rate", 20000, "--seed", 3]
    called = teamslam("team", log, "--out", tmp_path / "team", "--poses-per-piece", 9, *links)
    assert called.code == 0, called.err
    report = json.loads((tmp_path / "team" / "report.json").read_text())
    assert report["maps_equal"] and report["equal_to_offline"]
    assert {(link["from"], link["to"]) for link in report["links"]} == {(a, b) for a in "123" for b in "123" if a != b}
    offline = SubmapSet.of(*(build(piece) for piece in split(read(log), poses_per_piece=9))).join()
    assert [canonical(m) for m in read_submaps(tmp_path / "team" / "maps")] == [canonical(offline.map)]


def test_in_processes_over_sockets_it_is_the_offline_map_though_robots_are_killed(
    teamslam, log: Path, tmp_path: Path
) -> None:
    pytest.importorskip("zenoh")
    called = teamslam("team", log, "--out", tmp_path / "team", "--poses-per-piece", 9, "--speed", 8, "--kill", 1)
    assert called.code == 0, called.err
    report = json.loads((tmp_path / "team" / "report.json").read_text())
    assert report["maps_equal"] and report["equal_to_offline"] and report["online_position_rmse_m"] < 0.5
    assert {name: robot["rows"]["late"] for name, robot in report["robots"].items()} == {"1": 0, "2": 0, "3": 0}
    said = teamslam("status", tmp_path / "team")
    assert said.code == 0 and said.out.count("parked") == 3
    offline = SubmapSet.of(*(build(piece) for piece in split(read(log), poses_per_piece=9))).join()
    for folder in ("maps", "1/maps", "2/maps", "3/maps"):
        assert [canonical(m) for m in read_submaps(tmp_path / "team" / folder)] == [canonical(offline.map)]


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (("--loss", 1.0), "a share is from 0 to below 1"),
        (("--rate", -5), "a number above 0"),
        (("--poses-per-piece", 1), "at least 2 poses"),
        (("--kill", 2, "--in-memory"), "leave out --in-memory"),
        (("--speed", 2, "--loss", 0.1), "leave out --in-memory, --loss"),
    ],
)
def test_links_that_cannot_be_are_refused(
    teamslam, log: Path, tmp_path: Path, extra: tuple[object, ...], says: str
) -> None:
    called = teamslam("team", log, "--out", tmp_path / "out", *extra)
    assert called.code == 2 and says in called.err and not (tmp_path / "out").exists()


def test_a_robot_that_ends_by_itself_is_named_with_what_it_said(log: Path, tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    with pytest.raises(InputError, match=r"output.txt: robot [123] has ended by itself, with code 2: .* 2 poses"):
        convoy(log, read(log), [1, 2, 3], tmp_path, ["--poses-per-piece", "1"], 0, 0)


def test_where_no_robot_wrote_there_is_no_status(teamslam, tmp_path: Path) -> None:
    called = teamslam("status", tmp_path)
    assert called.code == 2 and "no robot has written one" in called.err


@pytest.mark.slow
def test_a_budget_is_kept_on_each_line_and_what_is_lacked_is_told(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("team", log, "--out", tmp_path / "out", "--poses-per-piece", 9, "--in-memory", "--budget", 2500)
    assert called.code == 1 and "some lack what others hold" in called.err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert all(0 < link["body_bytes"] <= 2500 for link in report["links"])
    assert any(link["withheld"] for link in report["links"])
    assert any(robot["missing"] for robot in report["robots"].values())


def test_under_a_budget_submaps_go_in_short_and_all_end_with_one_map(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("team", log, "--out", tmp_path / "out", "--poses-per-piece", 9, "--in-memory", "--budget", 8000)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert called.code == 0 and report["maps_equal"] and report["in_short"] > 0 and "condensed" in called.out
    assert any({"partial", "condensed"} & set(link["kinds"]) for link in report["links"])


def test_status_says_who_is_alive(teamslam, tmp_path: Path) -> None:
    """Of one that says nothing any more another tells that it is there; of one that nobody sees, nobody knows."""
    said = {"root": "00", "missing": 0, "holds": [], "links": {}}
    for name, more in (("1", {"alive": ["2"]}), ("2", {"alive": []}), ("3", {"alive": []}), ("4", {"ended": True})):
        (tmp_path / name).mkdir()
        (tmp_path / name / "status.json").write_text(json.dumps(said | {"robot": name} | more))
    for name in ("2", "3", "4"):
        os.utime(tmp_path / name / "status.json", (0, 0))
    os.utime(tmp_path / "1" / "status.json", (1e10, 1e10))  # it is always just now
    called = teamslam("status", tmp_path, "--json")
    assert called.code == 0
    assert [robot["is_alive"] for robot in json.loads(called.out)] == ["yes", "yes", "no", "ended"]


def test_status_says_who_holds_what_and_what_went_over_each_link(teamslam, tmp_path: Path) -> None:
    log, air = team("2d", robots=2, poses=20, landmarks=6), Air(Weather(), 0)
    members = [Member(Robot.of(log, n, Options(poses_per_piece=6)), Peer(n), air.link(n)) for n in (1, 2)]
    for member in members:
        for _, tables in replayed(log, member.robot.number):
            member.drive(tables)
        member.park()
    air.link(3).send(1, b"nonsense")
    now_s = time.monotonic()
    for turn in range(30):
        air.tick(now_s + turn - 30.0)
        for member in members:
            member.talk(now_s + turn - 30.0)
    for member in members:
        name = str(member.robot.number)
        (tmp_path / name).mkdir()
        with Journal(tmp_path / name / "journal.db", head_of(log, member.robot.number)) as journal:
            (tmp_path / name / "status.json").write_text(json.dumps(Driver(member, journal).status(log.names)))
    called = teamslam("status", tmp_path)
    sent = members[0].peer.lines[2].sent
    assert called.code == 1 and called.out.count(": 4 of 1, 4 of 2") == 2  # 1 refused a packet of nobody
    rows = [line.split() for line in called.out.splitlines()]
    heard = next(row for row in rows if row[:2] == ["1", "2"])
    bodies = [str(sent.bodies), f"{sent.body_bytes:,}", str(sent.words), f"{sent.word_bytes:,}", "0", "0"]
    assert heard[2:8] == bodies and 1.0 <= float(heard[8]) <= 60.0 and heard[9] == "0"
    assert next(row for row in rows if row[:2] == ["1", "3"])[-1] == "1"


def test_a_submap_that_is_held_and_in_no_map_is_told(teamslam, tmp_path: Path) -> None:
    """As where two robots go by one name: which of two submaps is right nobody can tell."""
    log = team("2d", robots=1, poses=9, landmarks=5)
    (piece,) = split(log)
    one = build(piece)
    other = replace(one, information=2.0 * one.information)
    member = Member(Robot.of(log, 1), Peer(1), Air(Weather(), 0).link(1))
    for submap in (one, other):
        member.peer = member.peer.with_bodies([send("sparse", submap, submap.values.layout.keys).data])
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        said = Driver(member, journal).status(log.names)
    assert "2 different submaps are all called 1/0" in said["left_out"]["1/0"]
    assert [e["event"] for e in happened({}, said)].count("left_out") == 1 and not list(happened(said, said))
    (tmp_path / "status.json").write_text(json.dumps(said))
    called = teamslam("status", tmp_path)
    assert called.code == 1 and "which is right cannot be told" in called.out


def test_a_log_without_rows_gives_no_map_and_says_so(teamslam, log: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for path in log.iterdir():
        text = path.read_text()
        (tmp_path / "empty" / path.name).write_text(text if path.suffix == ".toml" else text.splitlines(True)[0])
    called = teamslam("team", tmp_path / "empty", "--out", tmp_path / "out", "--in-memory")
    assert called.code == 1 and "no robot has rows that a submap could be made of" in called.err


def test_a_robot_whose_disk_is_full_is_alive_and_what_it_said_is_old(teamslam, tmp_path: Path) -> None:
    """Its process holds its journal, whatever its status says; it is gone with its process."""
    log = team("2d", robots=1, poses=5, landmarks=3)
    said = {"alive": [], "links": {}, "holds": [], "missing": 0, "root": "", "refused_packets": {}, "robot": "1"}
    (tmp_path / "1").mkdir()
    (tmp_path / "1" / "status.json").write_text(json.dumps(said))
    os.utime(tmp_path / "1" / "status.json", (0, 0))
    with Journal(tmp_path / "1" / "journal.db", head_of(log, 1)):
        called = teamslam("status", tmp_path / "1", "--json")
        (robot,) = json.loads(called.out)
        assert called.code == 1 and robot["is_alive"] == "yes"
        assert "it runs and has told nothing" in teamslam("status", tmp_path / "1").out
    called = teamslam("status", tmp_path / "1", "--json")
    assert json.loads(called.out)[0]["is_alive"] == "no" and called.code == 0


def test_nobody_hears_of_a_submap_that_its_robot_may_lose(tmp_path: Path) -> None:
    """While its disk is full a robot keeps what it makes to itself: what others hold is in its journal, always."""
    log, air = team("2d", robots=2, poses=20, landmarks=6), Air(Weather(), 0)
    habits, options = Habits(announce_s=1e-6, patience_s=1e-6), Options(poses_per_piece=6)
    one, two = (Member(Robot.of(log, n, options), Peer(n, habits), air.link(n)) for n in (1, 2))

    def talked(driver: Driver, turns: int = 12) -> set[str]:
        for turn in range(turns):
            air.tick(float(turn))
            driver.beat()
            two.talk(time.monotonic())
        return {submap.id for submap in two.peer.held.submaps}

    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        driver, rows = Driver(one, journal), [tables for _, tables in replayed(log, 1)]
        for n, tables in enumerate(rows):
            if n == 2 * len(rows) // 3:
                pages = journal._base.execute("PRAGMA page_count").fetchone()[0]
                journal._base.execute(f"PRAGMA max_page_count = {pages}")
            one.drive(tables)
            journal.step(one.robot)
            there = talked(driver, 2)
            assert there <= {opened(body.data).entry.id for body in journal.recall().bodies}
        one.park()
        there = talked(driver)
        made = {submap.id for submap in one.peer.own.values()}
        assert "full" in journal.trouble and there < made
        assert there <= {opened(body.data).entry.id for body in journal.recall().bodies}
        journal._base.execute("PRAGMA max_page_count = 100000")
        assert talked(driver, 30) == made and not journal.trouble
