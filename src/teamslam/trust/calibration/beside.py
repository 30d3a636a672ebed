"""What chance makes of a number that is asked of a map's residuals: the same asked of a few draws, piece by piece.

A number that adds up over many rows is asked of CUTS pieces of them. Between draws each piece varies by chance, and so
does the sum, by about as much as its pieces together (what rows far apart leave hangs together by next to nothing). So
a few draws say how far a number lies from what the model makes of it, with as many degrees of freedom as there are
pieces, each in all draws but one.
"""

import numpy as np

from teamslam.geometry import Array, IntArray

CUTS = 8


def in_pieces(numbers: Array) -> Array:
    """Sums (pieces, ...) of numbers (m, ...) over runs of rows that follow each other; CUTS of them, fewer of few."""
    starts: IntArray = np.unique(np.linspace(0, len(numbers), CUTS, endpoint=False).astype(np.int64))
    return np.add.reduceat(numbers, starts, axis=0) if len(numbers) else numbers


def odds(pieces: Array, *, squares: bool) -> float:
    """How likely chance makes the first of numbers that differ from the draws' as much as it does, from pieces (pieces,
    1 + draws). Of sums of `squares` by their cube roots (Wilson and Hilferty: nearly Gaussian for any number of
    them)."""
    from scipy.special import stdtr

    total, draws = pieces.sum(0), pieces.shape[1] - 1
    spread = pieces[:, 1:].var(-1, ddof=1)
    mean, variance = float(total[1:].mean()), float(spread.sum())
    if not variance > (1e-9 * mean) ** 2:  # nothing but rounding
        return 1.0
    told = (draws - 1) * variance**2 / float(np.sum(spread**2))
    deviation = np.sqrt(variance * (1.0 + 1.0 / draws))
    if squares:
        bend = deviation / mean / 3.0
        off = (np.cbrt(total[0] / mean) - 1.0 + bend**2) / bend
    else:
        off = (total[0] - mean) / deviation
    return 2.0 * float(stdtr(told, -abs(off)))


def odds_of_gaussian(numbers: Array) -> float:
    """How likely chance makes the first of each of numbers (n, 1 + draws) as large as they are together, where all are
    Gaussian of about one deviation."""
    from scipy.special import fdtrc

    drawn = float(np.mean(numbers[:, 1:] ** 2))
    count, draws = len(numbers), numbers.shape[1] - 1
    return float(fdtrc(count, count * draws, np.mean(numbers[:, 0] ** 2) / drawn)) if drawn > 0.0 else 1.0
