"""What the native kernel makes of a robot's filter, by the formulas and in plain numpy: on H and g of the rows
(`normal_equations`), where the kernel goes by their e and J."""

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.model import Kind, Table, pack, unpack
from teamslam.robot.filter import LITTLE, REPEATED, Filter
from teamslam.robot.order import Order, turning
from teamslam.solver import normal_equations


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
    before, after = (filter_.order.turning(x, filter_.centre) for x in (filter_.state, state))
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
        T[:, d:n] = order.turning(state, filter_.centre)[columns]
        H, g = T.T @ H @ T, T.T @ g
        gain = np.linalg.solve(np.eye(len(columns)) + H @ P_s[columns], np.column_stack([H, g + H @ so_far]))
        shift = P_s @ gain[:, -1]
        state = order.retract(filter_.state, shift, filter_.centre)
        ahead, so_far = shift[columns] - so_far, shift[columns]
        if not turned(filter_, ahead, places):
            break
    return state, filter_.covariance - P_s @ gain[:, :-1] @ P_s.T


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
    for kind, _, numbers, _ in order.parts:
        places = spread * rng.normal(size=(len(numbers), kind.dim))
        out[numbers] = pack(Pose.scattered(places, rng)) if kind.is_pose else places
    return out


def pose_at(state: Array, order: Order, place: int) -> Pose:
    """One of its poses."""
    kind = Kind(int(order.kinds[place]))
    found = unpack(state[order.rows(np.array([place]))], kind)
    assert isinstance(found, Pose)
    return found
