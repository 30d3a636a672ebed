"""Who contradicts the others, in words."""

from collections.abc import Hashable, Iterator, Sequence

from teamslam.model import Names
from teamslam.trust.influence.liars import Judgement


def sentences_on_robots(found: Judgement, names: Names) -> Iterator[str]:
    """Who lies and how sure that is; or that somebody does and nobody can say who; who contradicts itself."""
    if found.accused:
        rest = len(found.members) - len(found.accused)
        agree = "the others agree with each other" if rest > 1 else "the other is at one with itself"
        times = f"{found.whole.factor:,.2g} to {found.left.factor:,.2g} times what is expected"
        yield (
            f"{_robots(found.accused, names)} contradict{'s' * (len(found.accused) == 1)} the others: without "
            f"{'it' if len(found.accused) == 1 else 'them'} joining falls from {times}, and {agree} (by chance in "
            f"{_chance(found.significance)} of honest teams)"
        )
    elif found.settled:
        yield (
            f"robots contradict each other by the noise as it is stated ({found.whole.factor:,.2g} times what is "
            f"expected of joining), and no more once it is put right"
        )
    elif found.alternatives:
        ways = "; or ".join(_robots(a, names) if a else "all, by noise larger than stated" for a in found.alternatives)
        yield f"robots contradict each other, and nobody can say who is wrong: it may be {ways}"
    elif found.undecidable:
        yield (
            f"robots contradict each other ({found.whole.factor:,.2g} times what is expected of joining), and no "
            f"majority of them agrees: nobody can say who is wrong"
        )
    for robot, chance in found.themselves.items():
        yield (
            f"robot {names.robot(int(str(robot)))}'s own measurements contradict each other more than the others' do "
            f"(by chance in {_chance(chance)} of honest teams)"
        )


def _robots(robots: Sequence[Hashable], names: Names) -> str:
    called = [names.robot(int(str(robot))) for robot in robots]
    return f"robot{'s' * (len(called) > 1)} {' and '.join(called)}"


def _chance(share: float) -> str:
    return "less than 1e-99" if share < 1e-99 else f"{share:.1g}"
