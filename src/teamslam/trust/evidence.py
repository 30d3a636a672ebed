"""How likely it is that some of what was measured is wrong, by what all costs with it and without it.

Of a least-squares problem, D numbers to spare cost F. Without what is accused D_r cost F_r, so D_a = D - D_r of them
cost F_a = F - F_r. The noise may be larger than stated, by a factor that all share (of real logs 1 to 5), and what is
wrong by another:

    nothing is wrong    all D by one factor phi = F / D                 -2 log L = D (1 + log phi)
    some is             D_r by phi_r = F_r / D_r, D_a by b = F_a / D_a  -2 log L = D_r (1 + log phi_r) + D_a (1 + log b)

with factors of 1 at least, and a prior on phi: log normal, a factor of SPREAD either way. So an accusation needs a rest
that agrees: two who contradict each other accuse nobody.
"""

from dataclasses import dataclass
from math import comb, log, log1p

SPREAD = 4.0  # of the noise's variance over the stated one: by how much it may well be larger
SURE = 2.0 * log(1000.0)  # of -2 log L: a thousand to one


@dataclass(frozen=True)
class Fit:
    """What `cost` F the `dof` D numbers to spare of a problem come to."""

    cost: float
    dof: int

    @property
    def factor(self) -> float:
        """phi: by how much the noise is larger than stated, in variance; 1 at least."""
        return max(self.cost / self.dof, 1.0) if self.dof > 0 else 1.0

    def minus(self, rest: "Fit") -> "Fit":
        """What is gone with what was left out."""
        return Fit(max(self.cost - rest.cost, 0.0), self.dof - rest.dof)


def unlikely(whole: Fit, rest: Fit) -> float:
    """-2 log L that all is right but what `rest` is without; of `rest` = `whole`, that nothing is wrong. Prior odds of
    the accusation are the caller's."""
    gone = whole.minus(rest)
    return _deviance(rest) + _deviance(gone, rest.factor) + (log(rest.factor) / log(SPREAD)) ** 2


def _deviance(fit: Fit, least: float = 1.0) -> float:
    return fit.dof * (1.0 + log(max(fit.factor, least))) if fit.dof > 0 else 0.0


def significance(whole: Fit, rest: Fit, accused: int, of: int) -> float:
    """The probability that honest members look as bad by chance, at most: of any `accused` out of `of` (Bonferroni)."""
    return min(ratio_by_chance(whole.minus(rest), rest) * comb(of, accused), 1.0)


def ratio_by_chance(suspect: Fit, rest: Fit) -> float:
    """The probability that what is of one kind with the rest costs so much: by the ratio of their factors (Fisher's F),
    and by what noise as stated costs (chi-square), whichever is more."""
    from scipy.special import chdtrc, fdtrc

    if suspect.dof < 1 or rest.dof < 1:
        return 1.0
    by_ratio = float(fdtrc(suspect.dof, rest.dof, suspect.factor / rest.factor))
    return max(float(chdtrc(suspect.dof, suspect.cost)), by_ratio)


def most_to_gain(whole: Fit, dof: int = 0) -> float:
    """What an explanation that sets `dof` of the numbers to spare free, or more, can be likelier than that nothing is
    wrong, at most: whatever it is. With E = F - D the excess,

        D log phi + (log phi / log SPREAD)^2 - D_a log(1 + E / D_a)

    Law: `unlikely(whole, whole) - unlikely(whole, rest)` is no more than this, for every rest with `dof` numbers less.
    It is reached where the rest fits as stated, F_r = D_r: costing more, it gains less by the second term than it loses
    by the first; costing less, it leaves more to what is accused. And it falls as D_a grows.
    """
    excess = max(whole.cost - whole.dof, 0.0)
    spent = dof * log1p(excess / dof) if dof > 0 else 0.0
    return unlikely(whole, whole) - whole.dof - spent
