"""What a calibration found, in sentences: the same error of several robots in one."""

from collections.abc import Iterator, Sequence

from teamslam.trust.calibration.calibrate import Calibration
from teamslam.trust.calibration.systematic import Systematic
from teamslam.trust.cause import rows_called

IN_WORDS = {"depth": "measuring depth in place of distance (1: wholly)"}  # of terms whose name does not say it
SURELY, MOST = 4.0, 6  # sigmas from none, of what is told of single landmarks, and how many


def sentences(found: Calibration) -> list[str]:
    """What was wrong with the model of the data and was put right, most telling first; empty where nothing was."""
    return [*_systematic(found), *_scales(found), *_slips(found), *_lasting(found), *_sigmas(found)]


def _systematic(found: Calibration) -> Iterator[str]:
    kinds = dict.fromkeys((e.source, e.term, e.unit) for e in found.systematic)
    for source, term, unit in kinds:
        mine = [e for e in found.systematic if (e.source, e.term) == (source, term)]
        if mine[0].landmark:
            yield _of_landmarks(mine, found)
            continue
        values = ", ".join(f"{found.names.robot(e.robot)}: {_signed(e.value, e.sigma, unit)}" for e in mine)
        yield f"{rows_called(source)} err by {IN_WORDS.get(term, term)}, estimated and taken out (robot {values})"


def _of_landmarks(errors: Sequence[Systematic], found: Calibration) -> str:
    """Those that are surest to be there, one by one."""
    surest = sorted(errors, key=lambda e: -abs(e.value) / e.sigma)
    named = [e for e in surest if abs(e.value) > SURELY * e.sigma][:MOST] or surest[:1]
    several = len({e.robot for e in errors}) > 1
    values = ", ".join(
        f"{found.names.describe(e.landmark)}{f' from robot {found.names.robot(e.robot)}' if several else ''}: "
        f"{_signed(e.value, e.sigma, e.unit)}"
        for e in named
    )
    rest = f", and of {len(errors) - len(named)} others by less or less surely" if len(errors) > len(named) else ""
    return (
        f"{rows_called(errors[0].source)} err by a length of each landmark's own, as where its signal comes by way of "
        f"a wall, estimated and taken out ({values}{rest})"
    )


def _scales(found: Calibration) -> Iterator[str]:
    for source, part in dict.fromkeys((s.source, s.part) for s in found.scales):
        of: dict[str, list[str]] = {}
        for scale in found.scales:
            if (scale.source, scale.part) == (source, part):
                of.setdefault(f"{scale.scale:.2g}", []).append(found.names.robot(scale.robot))
        values = ", ".join(f"{times} for {_robots(list(dict.fromkeys(names)))}" for times, names in of.items())
        yield f"errors of {rows_called(source)} in {part} are not as large as stated, but times {values}"


def _robots(names: list[str]) -> str:
    return f"robot {names[0]}" if len(names) == 1 else f"robots {', '.join(names[:-1])} and {names[-1]}"


def _slips(found: Calibration) -> Iterator[str]:
    units = {"turn": "rad", "shift": "m"}
    for slip in found.slips:
        unit = f"{units[slip.name]} per root {'step' if found.names.counts else 'second'}"
        yield f"odometry has a {slip.name} noise beyond what is stated: {slip.density:.2g} {unit}"


def _lasting(found: Calibration) -> Iterator[str]:
    unit = "poses" if found.names.counts else "s"
    for each in found.lasting:
        same = each.persistence.same
        fades = f"{same.brief:.2f} fading over {same.lasting_s:.2g} {unit}" if same.brief > 0.0 else ""
        stays = f"{same.steady:.2f} that stays" if same.steady > 0.0 else ""
        how = " and ".join(part for part in (fades, stays) if part) or "between targets alone"
        yield (
            f"errors of {rows_called(each.source)} in {each.part} hang together in time (correlation {how}): "
            f"one counts as {1.0 / each.counts:.2g}"
        )


def _sigmas(found: Calibration) -> Iterator[str]:
    for of in found.sigmas:
        yield (
            f"places of {of.what} are known to {of.whole:.2g} m in the middle ({of.stated:.2g} m as stated): "
            f"{of.noise:.2g} m by the noise put right, the rest from systematic errors that stay uncertain"
        )


def _signed(value: float, sigma: float, unit: str) -> str:
    return f"{value:+.2g} +- {sigma:.1g}" + (f" {unit}" if unit else "")
