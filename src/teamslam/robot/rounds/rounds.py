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

from concurrent.futures import Executor, Future, wait

from teamslam.errors import TeamslamError
from teamslam.model import Submap
from teamslam.robot.link import HEARD
from teamslam.robot.packets import Answer, Packet, Question
from teamslam.robot.peer import Peer
from teamslam.robot.robot import Robot
from teamslam.robot.rounds.course import LONG, Account, Course, Heard, Out

AT_ONCE_S = 0.02  # what takes longer is gone on with beside


class Rounds:
    """A robot's side of exact rounds, whichever that is on the set that it holds now. `root` names that set; `courses`:
    one for each part of its map, once it stood for a while; `busy`: there may be a result yet.

    With an `executor` of one thread, work that takes long is gone on with there: the robot hears others meanwhile, and
    says what comes of it at one of its next turns."""

    def __init__(self, executor: Executor | None = None) -> None:
        self._executor = executor
        self._work: Future[Out] | None = None
        self._unheard: list[tuple[int, Packet]] = []
        self._first_s: float | None = None
        self._begin(b"", 0.0)

    def _begin(self, root: bytes, now_s: float) -> None:
        self.root, self._since_s, self._why = root, now_s, ""
        self.courses: tuple[Course, ...] | None = None
        self._more = False

    @property
    def busy(self) -> bool:
        """Whether there may be a result yet."""
        return self._more or self._work is not None

    @property
    def accounts(self) -> tuple[Account, ...]:
        """What they came to so far, part by part."""
        if self._why:
            return (Account((), None, self._why),)
        return tuple(course.account for course in self.courses or ())

    @property
    def maps(self) -> tuple[Submap, ...]:
        """The parts where rounds have put them, of all whose rounds have ended; what is at work is waited for."""
        if self._work is not None:
            self._work.exception()
        return tuple(found for course in self.courses or () if (found := course.map) is not None)

    def attend(self, now_s: float, peer: Peer, robot: Robot, heard: Heard, ready: bool) -> Out:
        """Questions and answers to be sent, after those that were `heard`. `ready`: there is nothing else to say."""
        if self._executor is None or (self._work is None and not ready):
            return self._turn(now_s, peer, robot, heard, ready)
        self._unheard = [*self._unheard, *heard][-HEARD:]  # what is lost is asked, or answered, again
        if self._work is None:
            heard, self._unheard = self._unheard, []
            self._work = self._executor.submit(self._turn, now_s, peer, robot, heard, ready)
        wait((self._work,), AT_ONCE_S)
        if not self._work.done():
            return []
        work, self._work = self._work, None
        return work.result()

    def _turn(self, now_s: float, peer: Peer, robot: Robot, heard: Heard, ready: bool) -> Out:
        if self._first_s is None:
            self._first_s = now_s
        if peer.root != self.root:
            self._begin(peer.root, now_s)
        if not ready:
            self._more = False
            return []
        spoken = [(s, p) for s, p in heard if isinstance(p, Question | Answer) and p.root == self.root]
        if self.courses is None:
            # What it lacks may come: to make a map of what it holds, whatever that takes, would be for nothing.
            rest_s = peer.habits.patience_s * (LONG if peer.missing else 1)
            if not spoken and now_s - self._since_s < rest_s:
                self._more = True
                return []
            self.courses = self._courses(now_s, self._first_s, peer)
        out = Out()
        for course in self.courses:
            out += course.attend(now_s, peer, robot, [(s, p) for s, p in spoken if p.part == course.number])
        self._more = any(course.busy for course in self.courses)
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
