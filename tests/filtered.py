"""What the native kernel makes of a robot's filter, by the formulas and in plain numpy: on H and g of the rows
(`normal_equations`), where the kernel goes by their e and J."""

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.model import Kind, Table, pack, unpack
from teamslam.model.layout import KIND_DOF
from teamslam.robot.ahead import Ahead
from teamslam.robot.filter import LITTLE, REPEATED, Filter
from teamslam.robot.order import Order, turning
from teamslam.solver import normal_equations


def parts(order: Order) -> list[tuple[Kind, bool, IntArray, IntArray]]:
    """Of each kind that there is, those that turn and those that do not: their numbers in the state (n, size) and
    their unknowns (n, dof)."""
    out = []
    for kind in map(Kind, np.unique(order.kinds).tolist()):
        for turns in (False, True):
            at = np.flatnonzero((order.kinds == kind) & (order.turns == turns))
            if len(at):
                numbers, unknowns = order.numbers[at, None], order.unknowns[at, None]
                out.append((kind, turns, numbers + np.arange(kind.size), unknowns + np.arange(kind.dof)))
    return out


def all_turning(order: Order, state: Array, centre: Array) -> Array:
    """How all unknowns of the mixed chart move as those that turn turn about the centre: (unknowns, axes)."""
    dim = len(centre)
    out = np.zeros((int(order.unknowns[-1]), rotations(dim).DOF))
    for kind, turns, numbers, unknowns in parts(order):
        if turns:
            out[unknowns] = turning(kind, state[numbers], centre)
    return out


def retract(order: Order, state: Array, delta: Array, centre: Array) -> Array:
    """x (+) delta, by the formulas above, on the numbers themselves."""
    out, d, n = state.copy(), len(centre), int(KIND_DOF[order.kinds[0]])
    half = rotations(d).exp(0.5 * delta[d:n]) if order.turns[0] else np.eye(d)
    turn = half @ half
    for kind, turns, numbers, unknowns in parts(order):
        e, there, step = kind.dim, state[numbers], delta[unknowns]
        if turns:
            there[:, :d] = (there[:, :d] - centre) @ turn.T + centre
            step[:, :d] = step[:, :d] @ half.T
        there[:, :e] += step[:, :e]
        if kind.is_pose:
            rotation = there[:, e:].reshape(-1, e, e)
            if turns:
                rotation[:, :d] = turn @ rotation[:, :d]
            if turns and unknowns[0, 0] == 0:
                step[0, e:] = 0.0  # its turn is that of all
            if step[:, e:].any():
                rotation = rotation @ rotations(e).exp(step[:, e:])
            there[:, e:] = rotation.reshape(len(there), -1)
        out[numbers] = there
    return out


def minus(order: Order, state: Array, other: Array) -> Array:
    """x (-) y in the mixed chart, of variables each by itorder."""
    out = np.zeros(int(order.unknowns[-1]))
    for kind, _, numbers, unknowns in parts(order):
        here, there = unpack(state[numbers], kind), unpack(other[numbers], kind)
        if isinstance(here, Pose) and isinstance(there, Pose):
            out[unknowns] = here.minus(there)
        else:
            out[unknowns] = state[numbers] - other[numbers]
    return out


def charted(turned: Array) -> Array:
    """How a pose that turns by so much moves in the mixed chart with its unknowns in the filter."""
    n, axes = turned.shape
    out = np.eye(n)
    out[:, n - axes :] = turned
    return out


def moved(filter_: Filter, table: Table, start: Pose) -> tuple[Array, Array]:
    """State and covariance at the next pose, which begins at `start`, by relative poses between the two.

    x_new = x (+) u            F = -D^-1 B', Q = D^-1 from H = [A B; B' D]
    """
    kind, old = filter_.kind, filter_.state[: filter_.kind.size]
    n, d = kind.dof, kind.dim
    keys = np.array([filter_.key, int(table.keys[table.keys != filter_.key][0])])
    _, H, g = normal_equations(table, keys, np.repeat(int(kind), 2), np.concatenate([old, pack(start)]))
    Q = np.linalg.inv(H[n:, n:])
    F, shift = -Q @ H[n:, :n], Q @ g[n:]
    there = (start if len(table) == 1 else start.retract(shift)).sharpened()
    state = np.concatenate([pack(there), filter_.state[kind.size :]])
    before, after = (all_turning(filter_.order, x, filter_.centre) for x in (filter_.state, state))
    # To the mixed chart of all, onward there, where nothing moves but the pose, and back to what turns with it.
    N = len(before)
    out, onward, noise, back = np.eye(N), np.eye(N), np.zeros((N, N)), np.eye(N)
    out[:, d:n], back[:, d:n] = before, after
    out[n:, n:] = back[n:, n:] = np.eye(N - n)
    onward[:n, :n], noise[:n, :n] = F, Q
    J = np.linalg.solve(back, onward @ out)
    return state, J @ filter_.covariance @ J.T + np.linalg.solve(back, np.linalg.solve(back, noise).T)


def seen(filter_: Filter, table: Table) -> tuple[Array, Array]:
    """State and covariance sharpened by rows: x (+) P_s (1 + H P_ss)^-1 (g + H d), P - P_s (1 + H P_ss)^-1 H P_s', s
    the variables that the rows speak of."""
    order, d, n = filter_.order, filter_.kind.dim, filter_.kind.dof
    places = np.array(sorted({0, *(order.place.get(key, 0) for key in table.keys[:, -1].tolist())}))
    rows, columns = order.rows(places), order.columns(places)
    P_s = filter_.covariance[:, columns]
    state, so_far = filter_.state, np.zeros(len(columns))
    for _ in range(REPEATED):
        _, H, g = normal_equations(table, order.keys[places], order.kinds[places], state[rows])
        T = np.eye(len(columns))
        T[:, d:n] = all_turning(order, state, filter_.centre)[columns]
        H, g = T.T @ H @ T, T.T @ g
        gain = np.linalg.solve(np.eye(len(columns)) + H @ P_s[columns], np.column_stack([H, g + H @ so_far]))
        shift = P_s @ gain[:, -1]
        state = retract(order, filter_.state, shift, filter_.centre)
        ahead, so_far = shift[columns] - so_far, shift[columns]
        if not turned(filter_, ahead, places):
            break
    return state, filter_.covariance - P_s @ gain[:, :-1] @ P_s.T


def told(filter_: Filter, ahead: Ahead, theirs: IntArray, fresh: IntArray) -> tuple[Array, Array]:
    """State and covariance with the variables at the places `fresh` of what the map knows:

    y_j | y_s = m_j + G (y_s - m_s)      G = S_js S_ss^-1      left over: S_jj - G S_sj
    """
    order, known, S = filter_.order, ahead.order, ahead.covariance
    mine = np.flatnonzero(~order.turns)
    columns, s, j = order.columns(mine), known.columns(theirs), known.columns(fresh)
    s, columns = (at[np.diagonal(S)[s] > 0.0] for at in (s, columns))  # but for the frame
    G = np.linalg.solve(S[np.ix_(s, s)], S[np.ix_(s, j)]).T
    away = np.zeros(int(known.unknowns[-1]))
    away[known.columns(theirs)] = minus(
        known.only(theirs), filter_.state[order.rows(mine)], ahead.state[known.rows(theirs)]
    )
    there = retract(known.only(fresh), ahead.state[known.rows(fresh)], G @ away[s], np.zeros(2))
    across = G @ filter_.covariance[columns]
    own = across[:, columns] @ G.T + S[np.ix_(j, j)] - G @ S[np.ix_(s, j)]
    return np.concatenate([filter_.state, there]), np.block([[filter_.covariance, across.T], [across, own]])


def turned(filter_: Filter, ahead: Array, places: Array) -> bool:
    """Whether a movement turns the pose of now, or the sight of some variables, by more than a little."""
    d, n = filter_.kind.dim, filter_.kind.dof
    if np.abs(ahead[d:n]).max() > LITTLE:
        return True
    if len(places) == 1:
        return False
    there = filter_.state[filter_.order.numbers[places[1:], None] + np.arange(2)]
    away = np.abs(there - filter_.state[:2]).sum(-1).min()
    return bool(np.abs(ahead[:d]).max() + np.abs(ahead[n:]).max() > LITTLE * away)


def pose_covariance(filter_: Filter) -> Array:
    """Of the pose of now, in the chart of `geometry.pose`."""
    kind = filter_.kind
    T = charted(turning(kind, filter_.state[None, : kind.size], filter_.centre)[0])
    return np.asarray(T @ filter_.covariance[: kind.dof, : kind.dof] @ T.T)


def scattered(order: Order, rng: np.random.Generator, spread: float) -> Array:
    """A state of some variables."""
    out = np.zeros(int(order.numbers[-1]))
    for kind, _, numbers, _ in parts(order):
        places = spread * rng.normal(size=(len(numbers), kind.dim))
        out[numbers] = pack(Pose.scattered(places, rng)) if kind.is_pose else places
    return out


def pose_at(state: Array, order: Order, place: int) -> Pose:
    """One of its poses."""
    kind = Kind(int(order.kinds[place]))
    found = unpack(state[order.rows(np.array([place]))], kind)
    assert isinstance(found, Pose)
    return found
