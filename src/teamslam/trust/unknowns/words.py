"""What was found of the unknowns of a log, in sentences."""

from teamslam.trust.unknowns.settle import Found, Settled


def sentences_of(settled: Settled) -> list[str]:
    """A sentence for each unknown, and one where they did not settle."""
    if settled.why:
        return [f"Nothing of what is only stated was estimated: {settled.why}."]
    out = [_sentence(found) for found in settled.found]
    if not settled.settled:
        out.append(f"They still moved after {settled.rounds} rounds: take them, and the map, with care.")
    return out


def _sentence(found: Found) -> str:
    of, name = found.unknown.of, found.unknown.name
    if not found.told and found.value != found.unknown.stated:  # somebody called it uncertain, so it may move
        before = f"{_number(found, found.unknown.stated)} +- {_number(found, found.unknown.prior)}"
        known = f"{_number(found, found.value)} +- {_number(found, found.sigma)}"
        return f"{of}: {name} {known}, hardly better known than was stated, {before}."
    if found.feigned is not None:
        feint = _number(found, found.feigned)
        return (
            f"{of}: {name} is as stated, {_number(found, found.value)}; {feint} fits better, but landmarks contradict "
            f"each other on it: what was carried about makes a camera seem late."
        )
    if not found.told:
        fits = found.sigma <= found.unknown.useful
        says = "does not contradict it" if fits else "does not tell it"
        known = f"the recording {says} (+- {_number(found, found.sigma)})"
        return f"{of}: {name} is as stated, {_number(found, found.value)}; {known}."
    change = (found.value - found.unknown.stated) / max(found.sigma, 1e-300)
    as_stated = f"; stated {_number(found, found.unknown.stated)}, {abs(change):.1f} sigma away"
    return f"{of}: {name} {_number(found, found.value)} +- {_number(found, found.sigma)}{as_stated}."


def _number(found: Found, value: float) -> str:
    unit = found.unknown.unit
    if found.unknown.name.endswith("drift"):
        return f"{1e6 * value:.1f} ppm"
    if unit == "s":
        return f"{1e6 * value:.3f} us" if found.unknown.name == "line time" else f"{1e3 * value:.2f} ms"
    if unit == "m":
        return f"{1e3 * value:.2f} mm"
    if unit == "px":
        return f"{value:.2f} px"
    if unit == "rad":
        return f"{value * 57.29577951308232:.3f} degrees"
    return f"{value:.5f}"
