"""Which systematic errors the data speak of: a choice by marginal likelihood, one kind of error after another.

With everything else eliminated (the map, by Schur complement) the errors p of candidates have information S and
gradient g. Errors of one kind, such as the scale of every robot's camera, are draws of N(0, tau^2) with one tau, which
the team itself shows (empirical Bayes). For kinds A with their priors T = diag(tau^2),

    log L(A) = 1/2 g_A' (S_A + T^-1)^-1 g_A - 1/2 log det(1 + T^1/2 S_A T^1/2)

is the marginal likelihood beside that of none. The next kind in is that which raises it most, at its best tau, if
chance alone does so in fewer than one team of a hundred, whatever the number of candidates (Bonferroni; twice the rise
is chi-square with one degree of freedom, or less). Then every tau is fitted again, and kinds that others have made
needless go out.

Of kinds that are `relative` (see `terms`) all this is of how they differ alone. What they have in common says of the
data what another kind says as well (ranges are too short, or odometry too long), and would come in with the differences
unasked. So it excuses nobody: other kinds are chosen, and their tau fitted, as if there were none. Of what is chosen it
is a part like any other, uncertain by as much as they differ, so that both share what the data leave between them.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import chi2_quantile

FALSE_ALARM = 0.01  # that any is chosen for a team whose sensors have none
TAUS = np.geomspace(1e-4, 4.0, 60)  # in units of the first guesses of the errors' sizes
ROUNDS, SETTLED = 30, 0.01  # of fitting all tau, until they change by less than this share


@dataclass(frozen=True, eq=False)
class Choice:
    """Places `inside` of the errors that are in, and the deviations `tau` of their priors."""

    inside: IntArray
    tau: Array

    @classmethod
    def all(cls, count: int) -> "Choice":
        """Every one, as its first guess lets it."""
        return cls(np.arange(count), np.ones(count))


def chosen(information: Array, gradient: Array, groups: IntArray, relative: BoolArray) -> Choice:
    """The kinds that the data speak of, from S (k, k), g (k,) and which kind each error is of (k,), some `relative`."""
    axes, owners = _told(groups, relative)
    seen, slope = axes.T @ information @ axes, axes.T @ gradient
    kinds = np.unique(groups).tolist()
    level = 0.5 * chi2_quantile(1.0 - 2.0 * FALSE_ALARM / max(len(kinds), 1), 1)
    taus: dict[int, float] = {}
    while True:
        beside = _beside(seen, slope, owners, taus)
        offers = [(*_offer(*beside, owners, kind), kind) for kind in kinds if kind not in taus]
        gain, tau, kind = max(offers, default=(0.0, 0.0, -1))
        if gain <= level:
            break
        taus[kind] = tau
        taus = _refitted(seen, slope, owners, taus)
    while taus:
        losses = []
        for kind in taus:
            others = {k: t for k, t in taus.items() if k != kind}
            losses.append((_offer(*_beside(seen, slope, owners, others), owners, kind)[0], kind))
        loss, kind = min(losses)
        if loss > level:
            break
        del taus[kind]
        taus = _refitted(seen, slope, owners, taus)
    inside = np.flatnonzero(np.isin(groups, list(taus)))
    return Choice(inside, np.array([taus[kind] for kind in groups[inside].tolist()]))


def posterior(information: Array, gradient: Array, tau: Array) -> tuple[Array, Array]:
    """The errors that are in, and their covariance, by S, g and the deviations tau of their priors."""
    precision = information + np.diag(1.0 / tau**2)
    covariance = np.asarray(np.linalg.inv(precision), float) if len(tau) else precision
    return covariance @ gradient, covariance


def differences(count: int) -> Array:
    """An orthonormal basis (count, count - 1) of what adds up to zero."""
    return np.linalg.qr(np.eye(count) - 1.0 / count)[0][:, : count - 1]


def _told(groups: IntArray, relative: BoolArray) -> tuple[Array, IntArray]:
    """What of the errors (k,) evidence is of, orthonormal (k, n): each alone, of `relative` kinds how they differ; and
    the kind of each of these (n,)."""
    axes, owners = [np.zeros((len(groups), 0))], [np.zeros(0, groups.dtype)]
    for kind in np.unique(groups).tolist():
        mine = np.flatnonzero(groups == kind)
        each = np.eye(len(groups))[:, mine]
        axes.append(each @ differences(len(mine)) if relative[mine[0]] else each)
        owners.append(np.full(axes[-1].shape[1], kind))
    return np.concatenate(axes, 1), np.concatenate(owners)


def _beside(information: Array, gradient: Array, groups: IntArray, taus: dict[int, float]) -> tuple[Array, Array]:
    """S and g of all errors when those that are in are eliminated."""
    inside = np.flatnonzero(np.isin(groups, list(taus)))
    if not len(inside):
        return information, gradient
    tau = np.array([taus[k] for k in groups[inside].tolist()])
    across = information[inside]
    solved = np.linalg.solve(information[np.ix_(inside, inside)] + np.diag(1.0 / tau**2), across)
    return information - across.T @ solved, gradient - solved.T @ gradient[inside]


def _offer(information: Array, gradient: Array, groups: IntArray, kind: int) -> tuple[float, float]:
    """By how much a kind raises log L at most, and the tau that does so; from S and g beside those that are in."""
    mine = np.flatnonzero(groups == kind)
    own = information[np.ix_(mine, mine)]
    sizes, axes = np.linalg.eigh(0.5 * (own + own.T))
    sizes, along = np.maximum(sizes, 0.0), (axes.T @ gradient[mine]) ** 2
    grown = 1.0 + TAUS[:, None] ** 2 * sizes
    gains = 0.5 * np.sum(along * TAUS[:, None] ** 2 / grown - np.log(grown), -1)
    best = int(np.argmax(gains))
    return float(gains[best]), float(TAUS[best])


def _refitted(information: Array, gradient: Array, groups: IntArray, taus: dict[int, float]) -> dict[int, float]:
    """All tau of greatest marginal likelihood, from where they are, by MacKay's rule: tau^2 = |p|^2 / gamma, with
    gamma = sum (1 - sigma^2 / tau^2) how many of the p the data tell."""
    inside = np.flatnonzero(np.isin(groups, list(taus)))
    information, gradient = information[np.ix_(inside, inside)], gradient[inside]
    members = {kind: np.flatnonzero(groups[inside] == kind) for kind in taus}
    for _ in range(ROUNDS):
        tau = np.array([taus[k] for k in groups[inside].tolist()])
        values, covariance = posterior(information, gradient, tau)
        before = dict(taus)
        for kind, at in members.items():
            p, spread = values[at], np.diag(covariance)[at]
            told = len(p) - float(spread.sum()) / taus[kind] ** 2
            taus[kind] = float(np.clip(np.sqrt(p @ p / max(told, 1e-9)), TAUS[0], TAUS[-1]))
        if all(abs(np.log(taus[kind] / before[kind])) < SETTLED for kind in taus):
            break
    return taus
