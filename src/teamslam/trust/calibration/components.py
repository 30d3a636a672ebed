"""What is free of odometry's noise, and how what is left of errors pulls at it.

C_i  =  S C_i S  +  sum_k theta_k B_ik          phi: logarithms of what is free of S^2 and of theta
Q_k  =  sum_i l_i' dC_i/dphi_k l_i ,            y_k = dC/dphi_k l ,   l = C^-1 left
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.products import by_rows
from teamslam.trust.calibration.slips import Slips

ROUNDING = 1e-9


@dataclass(frozen=True)
class Components:
    """What is free: `scaled`, parts of odometry's deviations, each with the tables that have it in common; and the
    numbers of slips (`slipping`)."""

    scaled: tuple[tuple[int, tuple[int, ...]], ...]
    slipping: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.scaled) + len(self.slipping)

    @classmethod
    def of(cls, slips: Sequence[Slips | None], scales: Sequence[Array]) -> "Components":
        """All that there may be, of tables with slips: what has one scale by now has it in common."""
        groups: dict[tuple[int, int, float], list[int]] = {}
        for k, slip in enumerate(slips):
            if slip is not None:
                for part, scale in enumerate(scales[k].tolist()):
                    groups.setdefault((len(scales[k]), part, scale), []).append(k)
        numbers = range(len(next(slip.units for slip in slips if slip is not None))) if groups else range(0)
        return cls(tuple((part, tuple(tables)) for (_, part, _), tables in sorted(groups.items())), tuple(numbers))

    def only(self, which: BoolArray) -> "Components":
        """Those that are chosen (k,)."""
        scaled = tuple(each for each, keep in zip(self.scaled, which, strict=False) if keep)
        return Components(
            scaled, tuple(k for k, keep in zip(self.slipping, which[len(self.scaled) :], strict=True) if keep)
        )

    def logs(self, scales: Sequence[Array], theta: Array) -> Array:
        """phi (k,)."""
        parts = [2.0 * np.log(scales[tables[0]][part]) for part, tables in self.scaled]
        return np.array([*parts, *np.log(np.maximum(theta[list(self.slipping)], 1e-300))])

    def put(self, logs: Array, scales: Sequence[Array], theta: Array) -> tuple[list[Array], Array]:
        """Scales and theta with these as phi (k,) has them."""
        scales, theta = [scale.copy() for scale in scales], theta.copy()
        for (part, tables), log in zip(self.scaled, logs, strict=False):
            for k in tables:
                scales[k][part] = np.exp(0.5 * log)
        theta[list(self.slipping)] = np.exp(logs[len(self.scaled) :])
        return scales, theta


@dataclass(frozen=True, eq=False)
class Pulls:
    """Of each component Q of what is left of errors measured and drawn (k, 1 + draws), and y of those measured (N, k);
    of slips in units of theta where they have `none` yet."""

    squares: Array
    along: Array

    @classmethod
    def of(
        cls,
        components: Components,
        slips: Sequence[Slips | None],
        now: Sequence[Noise],
        scales: Sequence[Array],
        theta: Array,
        both: Sequence[Array],
    ) -> "Pulls":
        """From what is left (m, rows, 1 + draws), table by table, by the noise as it is `now`, of scales and theta."""
        squares = np.zeros((len(components), both[0].shape[-1]))
        along = [np.zeros((*errors.shape[:2], len(components))) for errors in both]
        for k, (slip, noise, errors) in enumerate(zip(slips, now, both, strict=True)):
            if slip is None:
                continue
            pull = by_rows(np.swapaxes(noise.whitening, 1, 2), by_rows(noise.whitening, errors))
            pull *= slip.moving[:, None, None]
            stated = slip.stated * np.outer(scales[k], scales[k])
            spread = by_rows(stated, pull)  # S C S l, of which each part's logarithm moves its own
            for n, (part, tables) in enumerate(components.scaled):
                if k in tables:
                    squares[n] += np.einsum("mk,mk->k", pull[:, part], spread[:, part])
                    along[k][..., n] = 0.5 * stated[..., part] * pull[:, part, :1]
                    along[k][:, part, n] += 0.5 * spread[:, part, 0]
            for n, j in enumerate(components.slipping, len(components.scaled)):
                moved = by_rows(np.where(theta[j] > 0.0, theta[j], 1.0) * slip.units[j], pull)
                squares[n] += np.einsum("mrk,mrk->k", pull, moved)
                along[k][..., n] = moved[..., 0]
        return cls(squares, np.concatenate([each.reshape(-1, len(components)) for each in along]))

    @property
    def scores(self) -> Array:
        """f (k,)."""
        return np.asarray(0.5 * (self.squares[:, 0] - self.squares[:, 1:].mean(1)))


def _of_part(stated: Array, scale: Array, part: int) -> Array:
    """dC/dphi (m, r, r) of the logarithm of a part's squared scale."""
    share = np.zeros(len(scale))
    share[part] = 0.5
    return np.asarray(stated * np.outer(scale, scale) * (share[:, None] + share))


def told_apart(slips: Sequence[Slips]) -> Array:
    """The share of what rows tell of each slip, by their noise as stated, when neither scales nor other slips are known
    (slips,): next to none where all rows under way are alike, as a slip is then a scale."""
    sizes = sorted(
        {slip.stated.shape[-1] for slip in slips}
    )  # robots of the plane and of space have scales of their own
    starts = dict(zip(sizes, np.cumsum([0, *sizes])[:-1].tolist(), strict=True))
    scaled, count = sum(sizes), len(slips[0].units)
    information = np.zeros((scaled + count, scaled + count))
    for slip in slips:
        rows = slip.stated.shape[-1]
        stated = slip.stated[slip.moving]
        parts = [_of_part(stated, np.ones(rows), part) for part in range(rows)]
        moved = np.linalg.solve(stated[None], np.stack([*parts, *slip.units[:, slip.moving]]))
        at = np.append(starts[rows] + np.arange(rows), scaled + np.arange(count))
        information[np.ix_(at, at)] += 0.5 * np.einsum("kmij,lmji->kl", moved, moved)
    size = np.sqrt(np.diag(information))
    alone = 1.0 / np.diag(np.linalg.inv(information / np.outer(size, size) + ROUNDING * np.eye(len(size))))
    return np.asarray(alone[-count:])
