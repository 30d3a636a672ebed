"""The viewer: a server on this machine, its scene, and the panel that switches it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from teamslam.geometry import Array
from teamslam.viewer.nodes import Nodes
from teamslam.viewer.placed import Placed
from teamslam.viewer.server import address_of, framed, started, stopped

KINDS = {
    "ways": "ways",
    "robots": "robots",
    "landmarks": "landmarks",
    "names": "names",
    "regions": "95 % regions",
    "truth": "truth",
    "sightings": "sightings of landmarks",
    "seen": "sightings of robots",
    "second": "second places",
    "rejected": "wrong sightings",
    "doubted": "names in doubt",
    "weakest": "weakest direction",
}
TOLD = ("wrong", "suspicious", "weak", "known", "look next")  # of a run's summary
PLAYED_S = 30.0  # that playing a run takes


class Viewer:
    """Runs in one space, served at `address` until it is stopped. MissingExtraError where viser is not installed."""

    def __init__(self, runs: Sequence[Placed], *, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.runs = runs
        self.server: Any = started(host, port)
        places = _places(runs)
        self.size = float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0
        self.nodes = [
            [
                Nodes(
                    self.server.scene, f"/run{n}/part{m}", run.page, part, m, frame, self.size, paler=min(0.4 * n, 0.7)
                )
                for m, (part, frame) in enumerate(zip(run.page.parts, run.frames, strict=True))
            ]
            for n, run in enumerate(runs)
        ]
        self.server.initial_camera.look_at, self.server.initial_camera.position = framed(places)
        self._panel()
        self._show()

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return address_of(self.server)

    def step(self, seconds: float) -> None:
        """Let so much time pass: while it plays, the run goes on."""
        if self.playing.value:
            begin, end = self.span
            ahead = self.time.value + (end - begin) * seconds / PLAYED_S
            self.time.value = begin if ahead > end else ahead

    def stop(self) -> None:
        """Close the server, and what is connected to it."""
        stopped(self.server)

    def _panel(self) -> None:
        gui, pages = self.server.gui, [run.page for run in self.runs]
        stamps = [way.stamps[[0, -1]] for page in pages for part in page.parts for way in part.ways]
        self.span = (float(np.min(stamps)), max(float(np.max(stamps)), float(np.min(stamps)) + 1e-3))
        begin, end = self.span
        unit = "pose" if pages[0].counts else "s"
        with gui.add_folder("Time"):
            step = (end - begin) / 2000.0
            self.time = gui.add_slider(f"time [{unit}]", begin, end, step, end)
            self.window = gui.add_slider(
                f"sightings of the last [{unit}]", step, end - begin, step, (end - begin) / 60.0
            )
            self.playing = gui.add_checkbox("play", False)
        with gui.add_folder("Runs"):
            self.visible = [gui.add_checkbox(run.name, True) for run in self.runs]
        with gui.add_folder("Show"):
            self.kinds = {kind: gui.add_checkbox(word, kind != "second") for kind, word in KINDS.items()}
            times = max((part.magnification for page in pages for part in page.parts), default=1)
            self.times = gui.add_slider("regions larger by", 1.0, 100.0, 1.0, float(times))
        with gui.add_folder("Found", expand_by_default=True):
            for run in self.runs:
                gui.add_markdown(_found(run))
        robots = list(dict.fromkeys(robot for page in pages for robot in page.robots))
        with gui.add_folder("Robots", expand_by_default=len(robots) <= 12):
            self.robots = {robot: gui.add_checkbox(robot, True) for robot in robots}
        for control in (self.time, self.window, self.times):
            control.on_update(lambda _: self._move())
        for switch in (*self.visible, *self.kinds.values(), *self.robots.values()):
            switch.on_update(lambda _: self._show())

    def _show(self) -> None:
        kinds = {kind for kind, switch in self.kinds.items() if switch.value}
        with self.server.atomic():
            for run, on, parts in zip(self.runs, self.visible, self.nodes, strict=True):
                hidden = {n for n, robot in enumerate(run.page.robots) if not self.robots[robot].value}
                for nodes in parts:
                    nodes.at = self._now()
                    nodes.shown(kinds if on.value else set(), hidden)

    def _move(self) -> None:
        with self.server.atomic():
            for on, parts in zip(self.visible, self.nodes, strict=True):
                for nodes in parts if on.value else ():
                    nodes.moved(*self._now())

    def _now(self) -> tuple[float, float, float]:
        return float(self.time.value), float(self.window.value), float(self.times.value)


def _found(run: Placed) -> str:
    """What a run's map is worth, who is not to be believed and what is known least, in words."""
    page = run.page
    heading, told = "", [f"**{_plain(run.name)}**: {_plain(page.sentence)}"]
    for name, value in page.summary:
        heading = name or heading
        if heading in TOLD:
            told.append(f"- {f'*{heading}* ' if name else ''}{_plain(value)}")
    return "\n".join([told[0], "", *told[1:]])


def _plain(words: str) -> str:
    """Words that Markdown leaves as they are."""
    return "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#+-.!|~" else letter for letter in words)


def _places(runs: Sequence[Placed]) -> Array:
    """All that is shown (n, 3)."""
    return np.concatenate(
        [
            frame.act(np.concatenate([part.marks.places, *(way.places for way in part.ways)]))
            for run in runs
            for part, frame in zip(run.page.parts, run.frames, strict=True)
        ]
    )
