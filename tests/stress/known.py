"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000044): ("another optimum that fits as well is named",),
    ("small", 1000045): (
        "a sentence that cannot be checked: SolveError: landmark .. is fixed by the measurements, but the search for "
        "an optimum ended with it on top of a ",
    ),
    ("small", 1000065): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the "
        "start may be too far off.",
    ),
}
