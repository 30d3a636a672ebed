"""Robots in processes of their own: one of them, and a whole team of them on this machine."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teamslam.cli.driving import Source
    from teamslam.duty import Duty
    from teamslam.errors import InputError
    from teamslam.model import Dataset, Submap
    from teamslam.robot.link.zenoh import Address
    from teamslam.robot.packets import Body


QUIET_S, BUSY_S = 60.0, 600.0  # without news, before a team is taken to be at its end; while some work on something


def among(duty: "Duty", source: "Source", address: "Address") -> int:
    """One robot among its team until it is ended; it goes on from its journal where there is one."""
    from concurrent.futures import ThreadPoolExecutor

    from teamslam.beside import Beside
    from teamslam.cli.console import complain
    from teamslam.cli.driving import Disks, Finished, Shown
    from teamslam.cli.lasting import lasting
    from teamslam.convoy import Driver
    from teamslam.errors import InputError
    from teamslam.events import Events
    from teamslam.fleet import Member
    from teamslam.given_back import share
    from teamslam.io.files.whole import whole_file
    from teamslam.live import Mapper, begun
    from teamslam.results.fleet import joined
    from teamslam.results.poses import PoseFile
    from teamslam.results.words import counted
    from teamslam.robot.journal import Journal
    from teamslam.robot.link.keys import read_revocations, read_seal
    from teamslam.robot.link.zenoh import ZenohLink
    from teamslam.robot.peer import Peer
    from teamslam.robot.rounds import Rounds
    from teamslam.robot.rows import head_of
    from teamslam.robot.scribe import Scribe

    share()
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    out, dataset, events, wrong, disks = Path(str(duty.out)), source.log, Events(duty.events), 0, Disks()
    (out / "submaps").mkdir(parents=True, exist_ok=True)
    robot = address.robot
    with (
        Journal(out / "journal.db", head_of(dataset, robot)) as journal,
        PoseFile(out / "poses.csv", dataset.names, dataset.robots[robot]) as poses,
        ExitStack() as stack,  # whatever ends it, the link is closed: an open one would keep the process
    ):
        memory = journal.recall()
        start = begun(dataset, robot, duty.steps, memory)
        link = stack.enter_context(closing(ZenohLink(address)))
        beside = stack.enter_context(Beside(shown=duty.view is not None)) if duty.in_real_time else None
        shown = stack.enter_context(closing(Shown(duty.view, beside)))

        def report(driver: Driver) -> None:
            shown.show(driver.member.robot.now, driver.member.mapper.atlas, robot)
            for now in driver.member.told:
                poses.add(now)
            driver.member.told.clear()  # they are in the file
            poses.add(None)
            said = driver.status(driver.member.robot.head.names) | {"dropped": link.dropped, "shut_out": link.shut_out}
            disks.tell(journal=journal.trouble, poses=poses.trouble, events=events.trouble)
            said |= {"journal": disks.words}
            events.changed(said)
            try:
                with whole_file(out / "status.json") as file:
                    file.write(status_bytes(said))
                disks.tell(status="")
            except OSError as error:  # it maps on
                disks.tell(status=f"{error.filename}: {error.strerror}")

        def heard(error: "InputError") -> None:
            nonlocal wrong
            wrong += 1
            events.tell("wrong", reason=str(error))

        name = dataset.names.robot(robot)
        events.tell("begun", robot=name)
        told(f"robot {name} of team {address.team} listens at {address.listen}; how it stands: teamslam status {out}")
        peer = Peer(robot, duty.habits)
        if address.certificates is not None:
            seal = read_seal(address.certificates, address.team, robot, address.members, dataset.names)
            peer = Peer(robot, duty.habits, seal).recalling(read_revocations(address.certificates))
        peer = peer.recalling(memory.bodies)
        rounds = Rounds(stack.enter_context(ThreadPoolExecutor(1, "rounds")))
        member, kept = Member(start, peer, link, Mapper(beside), Scribe(beside), rounds), _known(memory.bodies)
        driver = Driver(member, journal, report, ended.is_set, source.names, kept=kept)
        stack.enter_context(lasting())
        stream = link.rows() if duty.remote else None
        whole = driver.drive(source.rows(start, memory, heard, stream), duty.speed)
    finished = Finished(out / "submaps")
    finished.add(driver.member.mapper.atlas.submaps)
    disks.tell(journal=journal.trouble, poses=poses.trouble, submaps=finished.trouble)
    left_out = driver.member.peer.left_out
    made = joined(driver.member.peer.held)
    try:
        written_anew([component.map for component in made.components] if made is not None else [], out / "maps")
        written_anew(driver.member.rounds.maps, out / "exact")
    except OSError as error:
        disks.tell(maps=f"{error.filename or out}: {error.strerror}; the map is not written")
    except InputError as error:  # a file that cannot be begun
        disks.tell(maps=f"{error}; the map is not written")
    for trouble in (*memory.damaged, *left_out.values()):
        complain(trouble)
    if wrong:
        complain(f"{counted(wrong, 'line')} made no sense and were left out")
    held = driver.member.peer.held.submaps
    robots, parts = {n for submap in held for n in submap.robots}, len(made.components) if made is not None else 0
    told(f"written: {out}: {counted(len(held), 'submap', len(robots), 'robot', parts, 'part')} of the map")
    code = 0 if whole and not wrong and not memory.damaged and not left_out and not disks.words else 1
    events.tell("ended", code=code)
    events.close()
    return code


def told(text: str) -> None:
    """One line of result; where nobody can be told, that ends nothing."""
    from teamslam.cli.console import say

    with suppress(OSError):
        say(text)


def written_anew(parts: "Sequence[Submap]", folder: Path) -> None:
    """The parts of a map in place of those that a folder holds of an earlier time."""
    from teamslam.io import write_submaps

    draft = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(draft, ignore_errors=True)
    if parts:
        write_submaps(parts, draft)
    if folder.is_dir():
        shutil.rmtree(folder)
    if parts:
        draft.rename(folder)


def _known(bodies: "Sequence[Body]") -> set[bytes]:
    """What names the bodies that are in a journal."""
    from teamslam.robot.packets import digest_of

    return {digest_of(body.data) for body in bodies}


def convoy(
    log: Path, dataset: "Dataset", numbers: Sequence[int], out: Path, extra: Sequence[str], kill: int, seed: int
) -> dict[str, Any]:
    """A process for each robot of a log, over sockets of this machine with certificates, until all hold the same; so
    often as `kill` says one is killed on the way, and started anew. The last status of each. InputError where a robot
    ends by itself."""
    import numpy as np

    from teamslam.robot.link.keys import make_certificates

    make_certificates(out / "secrets", numbers)
    places = {number: f"127.0.0.1:{_free_port()}" for number in numbers}
    processes = {number: _started(log, dataset, number, places, out, extra) for number in numbers}
    rng, quiet_since, known = np.random.default_rng(seed), time.monotonic(), list[Any]()
    kills, next_kill = kill, time.monotonic() + float(rng.uniform(2.0, 4.0))
    try:
        while True:
            time.sleep(0.2)
            status = {number: status_of(out / dataset.names.robot(number)) for number in numbers}
            for number, process in processes.items():
                _refuse_the_dead(dataset.names.robot(number), process.poll(), out)
            if kills and time.monotonic() > next_kill:
                victim = int(rng.choice(numbers))
                processes[victim].kill()
                processes[victim].wait()
                processes[victim] = _started(log, dataset, victim, places, out, extra)
                kills, next_kill = kills - 1, time.monotonic() + float(rng.uniform(2.0, 4.0))
            parked = all(s.get("parked") for s in status.values()) and not kills
            roots = [s.get("root") for s in status.values()]
            if not parked or roots != known:
                quiet_since, known = time.monotonic(), roots
            busy = not parked or any(s["making"] or s["rounds"]["busy"] for s in status.values())
            quiet_s = time.monotonic() - quiet_since
            if (not busy and len(set(roots)) == 1) or quiet_s > (BUSY_S if busy else QUIET_S):
                return {dataset.names.robot(number): s for number, s in status.items()}
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGTERM)
        for process in processes.values():
            process.wait(timeout=BUSY_S)


def status_bytes(said: dict[str, Any]) -> bytes:
    """What a robot says of itself as JSON that people can read. It leaves no circles of objects behind, as Python's own
    writer does: it is written twice a second for as long as the robot is there."""
    import msgspec

    return msgspec.json.format(msgspec.json.encode(said), indent=1)


def status_of(folder: Path) -> dict[str, Any]:
    """What a robot last said of itself; nothing where it said nothing yet."""
    try:
        found: dict[str, Any] = json.loads((folder / "status.json").read_text(encoding="utf-8"))
        return found
    except (OSError, ValueError):
        return {}


def _started(
    log: Path, dataset: "Dataset", number: int, places: dict[int, str], out: Path, extra: Sequence[str]
) -> "subprocess.Popen[bytes]":
    name = dataset.names.robot(number)
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "teamslam", "robot", str(log), "--robot", name, "--out", str(folder), "--resume"]
    command += ["--listen", places[number], "--certificates", str(out / "secrets"), *extra]
    command += ["--connect", *(place for other, place in places.items() if other != number)]
    command += ["--members", *map(str, places)]
    with (folder / "output.txt").open("ab") as output:
        return subprocess.Popen(command, stdout=output, stderr=output, env={**os.environ, "OMP_NUM_THREADS": "1"})


def _refuse_the_dead(name: str, code: int | None, out: Path) -> None:
    from teamslam.errors import InputError

    if code is None:
        return
    said = out / name / "output.txt"
    last = next(iter(said.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]), "it said nothing")
    raise InputError(f"robot {name} has ended by itself, with code {code}: {last}", path=said)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
