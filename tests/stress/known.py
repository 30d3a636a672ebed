"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000000): ("exactness is what a step promises",),
    ("small", 1000044): ("another optimum that fits as well is named",),
    ("small", 1000045): ("true: not determined",),
    ("small", 1000065): (
        "a sentence that cannot be checked: Stopped at the limit of iterations before the gradient was small enough.",
    ),
    ("small", 1000077): ("true: not determined",),
}
