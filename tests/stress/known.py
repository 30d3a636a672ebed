"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000003): ("no map costs more than the optimum from the truth",),
    ("small", 1000044): ("another optimum that fits as well is named",),
    ("small", 1000045): ("true: fixed, but not found",),
    ("small", 1000065): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the "
        "start may be too far off.",
    ),
    ("small", 1000074): ("left out: a landmark with which no solve ends",),
}
