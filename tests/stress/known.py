"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""
# ruff: noqa: E501

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000000): ("a report's cost is that of the rows",),
    ("small", 1000003): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000005): ("left out: a landmark that its rows leave open",),
    ("small", 1000007): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000031): ("left out: a landmark that its rows leave open",),
    ("small", 1000033): ("true: no frame fits the ranges",),
    ("small", 1000044): (
        "a map costs no more than the optimum from the truth",
        "honest noise is no misfit",
    ),
    ("small", 1000045): ("true: not determined",),
    ("small", 1000068): ("true: no frame fits the ranges",),
    ("small", 1000070): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000072): ("true: ranges leave it open",),
    ("small", 1000074): ("left out: a piece, true: not determined",),
    ("small", 1000077): ("true: not determined",),
    ("small", 1000083): (
        "left out: a piece, a sentence that cannot be checked: a submap of .. variables did not converge after .. iterations (distance to go .. sigma). Stopped at the limit ",
    ),
    ("mrclam5a.pyfg", 1000001): ("true: shares nothing",),
    ("plaza2.pyfg", 1000001): ("true: no frame fits the ranges",),
    ("plaza2.pyfg", 1000002): ("true: no frame fits the ranges",),
}
