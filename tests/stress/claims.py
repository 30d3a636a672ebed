"""CLAIMS: every sentence that may come with a map or instead of one, and how its truth is found.

A sentence that no pattern knows is a failure of its own: what is said must be such that it can be checked.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from stress.maps import rows_of, step_from
from stress.oracle import Oracle, TooLarge, lever, spoken_of
from teamslam.joining import Component
from teamslam.model import WORLD, Names, Table, is_pose, robot_of

WEAK_TURN = 0.2  # [rad]: a heading that is held no better may be called open
WEAK_PLACE = 0.2  # of the distance
BEYOND = 4.5  # [sigmas]: no honest noise, of a few hundred numbers
SHORT = 1e-3  # [sigmas] of an optimum: less is none
FAR_APART = 1e5  # sigmas of rows: their squares take up most of the digits that there are


@dataclass(frozen=True, eq=False)
class Saying:
    """A sentence in its context: what matched, and of which component (None for an error's)."""

    match: re.Match[str]
    outcome: Outcome
    oracle: Oracle
    component: Component | None = None

    def __getitem__(self, group: str) -> str:
        return self.match[group]

    @property
    def names(self) -> Names:
        """What things are called."""
        return self.outcome.log.names


Check = Callable[[Saying], bool]


def check_sentences(outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """All that was said, sentence by sentence."""
    if outcome.error is not None:
        _check(f"{type(outcome.error).__name__}: {outcome.error}", outcome, oracle, None, findings)
        return
    assert outcome.joined is not None
    apart = [c for c in outcome.components[1:]]
    reasons = list(outcome.joined.reasons)
    findings.check("each component apart has its reason", len(reasons) == len(apart), f"{len(reasons)}, {len(apart)}")
    for reason in reasons:
        _check(reason, outcome, oracle, None, findings)
    for component in outcome.components:
        for sentence in component.ambiguities:
            _check(sentence, outcome, oracle, component, findings)
        if component.solution is not None:
            _check(component.solution.status.value, outcome, oracle, component, findings)


def _check(sentence: str, outcome: Outcome, oracle: Oracle, component: Component | None, findings: Findings) -> None:
    for name, (pattern, check) in CLAIMS.items():
        if match := re.search(pattern, sentence, re.DOTALL):
            try:
                findings.check(f"true: {name}", check(Saying(match, outcome, oracle, component)), sentence)
            except TooLarge:
                findings.unchecked[name] += 1
            return
    findings.check(f"a sentence that cannot be checked: {_shape(sentence)}", False, sentence)


def is_true(sentence: str, what: str, outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """One sentence from elsewhere; `what` says where."""
    own = Findings()
    _check(sentence, outcome, oracle, None, own)
    findings.held.update({f"{what}, {kind}": count for kind, count in own.held.items()})
    findings.failures += [replace(failure, kind=f"{what}, {failure.kind}") for failure in own.failures]
    findings.unchecked.update(own.unchecked)


def _shape(sentence: str) -> str:
    return re.sub(r"'[^']*'|[-+]?\d[\d.e+-]*", "..", sentence)[:110]


# --- who is meant -------------------------------------------------------------------------------------------------


def _keys_called(saying: Saying, words: str) -> list[int]:
    """The variables that some words may mean."""
    keys = spoken_of(saying.outcome.log.tables)
    return [int(k) for k in keys if saying.names.describe(int(k)) == words]


def _component_of(saying: Saying, key: int) -> Component | None:
    return next((c for c in saying.outcome.components if key in set(c.map.keys.tolist())), None)


# --- checks -------------------------------------------------------------------------------------------------------


def _shares_nothing(saying: Saying) -> bool:
    """The component that begins there speaks of nothing that another one does."""
    for key in _keys_called(saying, saying["base"]):
        component = _component_of(saying, key)
        log = saying.outcome.log
        own = [t.select((t.keys == key).any(1)) for t in log.tables]  # of a pose that is in no map
        mine = spoken_of(list(rows_of(component.map, log)) if component else own)
        rest = [list(rows_of(c.map, log)) for c in saying.outcome.components if c is not component]
        theirs = np.unique(np.concatenate([spoken_of(rows) for rows in rest]))
        return not np.isin(mine, theirs[theirs != WORLD]).any()
    return False


def _can_turn(saying: Saying) -> bool:
    """Some pose of the first map is open, or weak, seen from the component that begins there."""
    return any(_loose(saying, key) for key in _keys_called(saying, saying["base"]))


def _loose(saying: Saying, key: int) -> bool:
    component = _component_of(saying, key)  # none of a pose that is in no map
    others = [c.map for c in saying.outcome.components if c is not component]
    poses = [int(k) for m in others for k in m.keys if is_pose(int(k))]
    return all(weak(saying.oracle, key, other) for other in poses[:1] + poses[-1:])


def weak(oracle: Oracle, one: int, other: int) -> bool:
    """Whether a variable seen from a pose is open, or held so loosely that nobody would call it known."""
    relation = oracle.between(one, other)
    if oracle.freedom(relation):
        return True
    dim = 3 if len(relation) in (3, 6) and len(relation) == 6 else 2
    if len(relation) == 3 and not is_pose(other):
        dim = 3
    sigmas = oracle.sigmas(relation)
    far = lever(oracle, one, other)
    return bool((sigmas[:dim] > WEAK_PLACE * far).any() or (sigmas[dim:] > WEAK_TURN).any())


def _not_determined(saying: Saying) -> bool:
    """It is open or weak, seen from every pose of its own robot, or of one that sees it."""
    for key in _keys_called(saying, saying["what"]):
        tables = [t.select((t.keys == key).any(1)) for t in saying.oracle.tables]
        around = [int(k) for k in spoken_of(tables) if k != key and is_pose(int(k))]
        if not around or all(weak(saying.oracle, pose, key) for pose in around):
            return True
    return False


def _fixed_but_lost(saying: Saying) -> bool:
    """No direction of it is open, seen from some pose beside it, and what is told to look for is there: rows that
    contradict each other, or sigmas that are very far apart."""
    for key in _keys_called(saying, saying["what"]):
        tables = [t.select((t.keys == key).any(1)) for t in saying.oracle.tables]
        around = [int(k) for k in spoken_of(tables) if k != key and is_pose(int(k))]
        fixed = any(not saying.oracle.freedom(saying.oracle.between(pose, key)) for pose in around)
        if fixed and at_odds(saying.oracle, tables):
            return True
    return False


def _lost_in_rounding(saying: Saying) -> bool:
    """It is open or weak, or what is told to look for is there."""
    if _not_determined(saying):
        return True
    keys = _keys_called(saying, saying["what"])
    return any(at_odds(saying.oracle, [t.select((t.keys == k).any(1)) for t in saying.oracle.tables]) for k in keys)


def at_odds(oracle: Oracle, rows: Sequence[Table]) -> bool:
    """Whether some rows of a variable contradict the truth, or its rows and those about their poses say what they say
    with sigmas so far apart that no sum of their squares holds both."""
    seers = spoken_of(rows)
    around = [t.select(np.isin(t.keys, seers).any(1)) for t in oracle.tables]
    around = [t for t in around if len(t)]
    if any(float(np.abs(t.whitened(oracle.truth)).max()) > BEYOND for t in around):
        return True
    sharp = np.concatenate([np.linalg.svd(t.whitening, compute_uv=False).ravel() for t in around])
    sharp = sharp[sharp > 0.0]
    return bool(sharp.max() > FAR_APART * sharp.min())


def _stands_alone(saying: Saying) -> bool:
    """No row ties the pose to another one of its robot, and whatever is seen from it is open or weak from there, by
    what is seen from there alone."""
    log = saying.outcome.log
    for key in _keys_called(saying, saying["base"]):
        tables = [t.select((t.keys == key).any(1)) for t in saying.oracle.tables]
        own = [k for k in spoken_of(tables) if k not in (key, WORLD) and robot_of(k) == robot_of(key)]
        there = [t.select(t.keys[:, 0] == key) for t in log.tables if not t.row.unary]
        seen = Oracle(log.with_tables(t for t in there if len(t)))
        others = [int(k) for k in spoken_of(there) if k != key]
        if not own and all(weak(seen, key, other) for other in others):
            return True
    return False


def _world_open(saying: Saying) -> bool:
    """Turning the whole map about costs nothing, or little."""
    return any(turns_in_the_world(saying.oracle, int(own[0])) for own in saying.oracle.robots.values())


def turns_in_the_world(oracle: Oracle, pose: int) -> bool:
    """Whether the orientation of a pose in the world is open, or held so loosely that nobody would call it known."""
    unknowns = oracle.truth.layout.unknowns(np.array([pose]))
    dim = 2 if len(unknowns) == 3 else 3
    relation = np.zeros((len(unknowns) - dim, oracle.truth.layout.dof))
    relation[np.arange(len(unknowns) - dim), unknowns[dim:]] = 1.0
    return bool(oracle.freedom(relation) or (oracle.sigmas(relation) > WEAK_TURN).any())


def moves_in_the_world(oracle: Oracle, pose: int) -> bool:
    """Whether it is free to turn there, or to shift."""
    unknowns = oracle.truth.layout.unknowns(np.array([pose]))
    shift = np.zeros((len(unknowns), oracle.truth.layout.dof))
    shift[np.arange(len(unknowns)), unknowns] = 1.0
    return turns_in_the_world(oracle, pose) or bool(oracle.freedom(shift))


def _no_link(saying: Saying) -> bool:
    """It stands in no error of a run: a log is cut where its odometry is broken."""
    return False


def _nothing_measured(saying: Saying) -> bool:
    return not spoken_of(saying.outcome.log.tables).size


def _costs(saying: Saying) -> bool:
    """The map's cost is the one named, and the other is not lower."""
    assert saying.component is not None
    return np.isclose(float(saying["mine"]), saying.component.map.cost, rtol=1e-5) and float(saying["more"]) >= 0.0


def _converged(saying: Saying) -> bool:
    return True  # the map's own check


def _is_short(saying: Saying) -> bool:
    """The gradient at the map is not small, in sigmas."""
    assert saying.component is not None
    rows = list(rows_of(saying.component.map, saying.outcome.log))
    return not saying.outcome.exact or step_from(saying.component.map, rows) > SHORT


def _is_explained(saying: Saying) -> bool:
    """A remark says of this map why it is a join's, where one was asked for that is exact."""
    assert saying.outcome.joined is not None and saying.component is not None
    which = " and ".join(sorted(saying.component.members))
    why = [r for r in saying.outcome.joined.remarks if r.startswith(f"not exact: the map of {which} is")]
    return saying.outcome.exact and len(why) == 1


def _could_hold(saying: Saying) -> bool:
    """Where nothing is special, here near the truth, all rows together hold the component to another one."""
    log = saying.outcome.log
    assert log.truth is not None
    shift = np.random.default_rng(0).normal(size=log.truth.layout.dof)
    elsewhere = Oracle(replace(log, truth=log.truth.retract(shift)))
    for key in _keys_called(saying, saying["base"]):
        others = [c.map for c in saying.outcome.components if c is not _component_of(saying, key)]
        poses = [int(m.keys[is_pose(m.keys)][0]) for m in others if is_pose(m.keys).any()]
        if any(not elsewhere.freedom(elsewhere.between(pose, key)) for pose in poses):
            return True
    return False


WHO = r"the submaps of robot (?P<robot>.+?) from (?P<base>.+?) on"
TOGETHER = r"^together no map of them was found: "
CLAIMS: dict[str, tuple[str, Check]] = {
    "shares nothing": (WHO + r" share nothing with the map", _shares_nothing),
    "can still turn": (WHO + r" share only (?P<things>.+) with the map and can still turn", _can_turn),
    "ranges leave it open": (
        WHO + r" are tied to the map by .*, which leave (?P<open>\d+) directions? of their frame open",
        _can_turn,
    ),
    "held but loosely": (
        WHO + r" are tied to the map by .*, which at these sigmas hold their frame but loosely",
        _can_turn,
    ),
    "no place was found": (
        WHO + r" are tied to the map by .*, which could hold their frame, but no place",
        _could_hold,
    ),
    "ambiguous": (r"ambiguous: .* this map costs (?P<mine>[^,]+), the other about (?P<more>[^ ]+?) more\. ", _costs),
    "together not determined": (TOGETHER + r"(?P<base>.+) is not determined", _can_turn),
    "together fixed, but not found": (
        TOGETHER + r"(?P<what>.+) is fixed by the measurements, but the search for an optimum ended",
        _fixed_but_lost,
    ),
    "not determined": (r"^(SolveError: )?(?P<what>.+) is not determined by", _not_determined),
    "not determined, to within rounding": (
        r"^(SolveError: )?(?P<what>.+) is not determined, to within rounding: ",
        _lost_in_rounding,
    ),
    "fixed, but not found": (
        r"^(SolveError: )?(?P<what>.+) is fixed by the measurements, but the search for an optimum ended",
        _fixed_but_lost,
    ),
    "stands alone": (r"^(SolveError: )?(?P<base>.+) stands alone: no odometry leads to it or from it", _stands_alone),
    "the world is open": (r"the map's orientation in the world is not determined", _world_open),
    "no odometry links": (r"no odometry links (?P<what>.+) to (?P<base>.+); cut the log", _no_link),
    "nothing measured": (r"there is nothing to join", _nothing_measured),
    "converged": (r"^Converged: ", _converged),
    "stopped short": (r"^Stopped: no step lowers the cost although the gradient is not small", _is_short),
    "stopped at the limit": (r"^Stopped at the limit of iterations before the gradient was small", _is_short),
    "not exact": (r"^Stopped: no optimum of all rows was found; this is the join", _is_explained),
    "all fixed": (
        r"^Nothing to estimate",
        lambda saying: saying.component is not None and not saying.component.map.dof,
    ),
}
