"""Exact rounds between robots: when all hold the same and have nothing more to say, the team goes on to the full least
squares, though nobody holds all raw data (`joining.exact`).

    lowest robot here     asks:    where are you, what would it cost you there, go there
    the others            answer:  for their own submaps, from their own rows

What is spoken of, all make alike of the set that they hold: the root that names it names the rounds too, and each part
of its map has its own. A question is asked again until it is answered, and answered again from memory; so packets may
be lost, late and repeated (`pace` says how long an answer is waited for). Who does not answer for long ends an attempt,
and the rounds begin anew, some times: without that robot's rows, if it is away. Anything new that is heard ends them as
well. What was there before, the map of the set, stays as it was: rounds give what is better beside it, or the reason
why not.
"""

from teamslam.errors import TeamslamError
from teamslam.model import Submap
from teamslam.robot.packets import Answer, Question
from teamslam.robot.peer import Peer
from teamslam.robot.robot import Robot
from teamslam.robot.rounds.course import LONG, Account, Course, Heard, Out


class Rounds:
    """A robot's side of exact rounds, whichever that is on the set that it holds now. `root` names that set; `courses`:
    one for each part of its map, once it stood for a while; `busy`: there may be a result yet."""

    def __init__(self) -> None:
        self._first_s: float | None = None
        self._begin(b"", 0.0)

    def _begin(self, root: bytes, now_s: float) -> None:
        self.root, self._since_s, self._why = root, now_s, ""
        self.courses: tuple[Course, ...] | None = None
        self.busy = False

    @property
    def accounts(self) -> tuple[Account, ...]:
        """What they came to so far, part by part."""
        if self._why:
            return (Account((), None, self._why),)
        return tuple(course.account for course in self.courses or ())

    @property
    def maps(self) -> tuple[Submap, ...]:
        """The parts where rounds have put them, of all whose rounds have ended."""
        return tuple(found for course in self.courses or () if (found := course.map) is not None)

    def attend(self, now_s: float, peer: Peer, robot: Robot, heard: Heard, ready: bool) -> Out:
        """Questions and answers to be sent, after those that were `heard`. `ready`: there is nothing else to say."""
        if self._first_s is None:
            self._first_s = now_s
        if peer.root != self.root:
            self._begin(peer.root, now_s)
        if not ready:
            self.busy = False
            return []
        spoken = [(s, p) for s, p in heard if isinstance(p, Question | Answer) and p.root == self.root]
        if self.courses is None:
            # What it lacks may come: to make a map of what it holds, whatever that takes, would be for nothing.
            rest_s = peer.habits.patience_s * (LONG if peer.missing else 1)
            if not spoken and now_s - self._since_s < rest_s:
                self.busy = True
                return []
            self.courses = self._courses(now_s, self._first_s, peer)
        out = Out()
        for course in self.courses:
            out += course.attend(now_s, peer, robot, [(s, p) for s, p in spoken if p.part == course.number])
        self.busy = any(course.busy for course in self.courses)
        return out

    def _courses(self, now_s: float, first_s: float, peer: Peer) -> tuple[Course, ...]:
        submaps = peer.held.submaps
        try:
            parts = peer.held.join().components if submaps else ()
        except TeamslamError as error:
            self._why = str(error)
            return ()
        by_id = {submap.id: submap for submap in submaps}
        return tuple(Course(self.root, n, part, by_id, now_s, first_s) for n, part in enumerate(parts))
