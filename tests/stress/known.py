"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""
# ruff: noqa: E501

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000000): ("a report's cost is that of the rows",),
    ("small", 1000005): ("left out: a landmark that its rows leave open",),
    ("small", 1000007): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000009): ("true: ranges leave it open",),
    ("small", 1000031): ("left out: a landmark that its rows leave open",),
    ("small", 1000035): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000038): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000044): (
        "a map costs no more than the optimum from the truth",
        "honest noise is no misfit",
    ),
    ("small", 1000045): ("true: not determined",),
    ("small", 1000047): ("true: ranges leave it open",),
    ("small", 1000048): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000067): ("true: ranges leave it open",),
    ("small", 1000068): ("true: can still turn",),
    ("small", 1000069): ("true: can still turn",),
    ("small", 1000070): ("true: can still turn",),
    ("small", 1000071): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000072): ("true: can still turn",),
    ("small", 1000074): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000075): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000077): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000083): (
        "a report's cost is that of the rows",
        "left out: a piece, a sentence that cannot be checked: a submap of .. variables did not converge after .. iterations (distance to go .. sigma). Stopped at the limit ",
        "true: can still turn",
    ),
    ("small", 1000100): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000101): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000104): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000120): ("left out: poses that rows leave open",),
    ("small", 1000123): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000127): ("true: can still turn",),
    ("small", 1000129): ("true: not determined",),
    ("small", 1000143): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the start may be too far off.",
        "true: can still turn",
    ),
    ("small", 1000146): ("true: not determined",),
    ("small", 1000152): ("a map's errors are those that it expects",),
    ("small", 1000153): (
        "honest noise is no misfit",
        "true: no frame fits the ranges",
        "true: ranges leave it open",
    ),
    ("small", 1000165): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000167): ("true: ranges leave it open",),
    ("small", 1000168): ("true: ranges leave it open",),
    ("small", 1000171): ("true: not determined",),
    ("small", 1000177): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000178): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000181): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000196): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000202): (
        "a map's errors are those that it expects",
        "honest noise is no misfit",
    ),
    ("small", 1000203): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000208): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000211): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000221): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000222): ("true: not determined",),
    ("small", 1000224): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000246): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000262): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the start may be too far off.",
    ),
    ("small", 1000263): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the start may be too far off.",
    ),
    ("small", 1000267): (
        "left out: a landmark that its rows leave open",
        "true: ranges leave it open",
    ),
    ("small", 1000271): ("a map's errors are those that it expects",),
    ("small", 1000283): ("left out: a landmark that its rows leave open",),
    ("small", 1000288): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the start may be too far off.",
        "information is that of the rows",
    ),
    ("small", 1000293): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000301): ("true: can still turn",),
    ("small", 1000305): (
        "a report's cost is that of the rows",
        "left out: a piece, a sentence that cannot be checked: a submap of .. variables did not converge after .. iterations (distance to go .. sigma). Stopped: no step lowe",
        "true: can still turn",
    ),
    ("small", 1000308): ("true: can still turn",),
    ("small", 1000309): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000311): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000318): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000327): ("true: ranges leave it open",),
    ("small", 1000332): ("true: no frame fits the ranges",),
    ("small", 1000336): (
        "a sentence that cannot be checked: Stopped at the limit of iterations before the gradient was small enough.",
    ),
    ("small", 1000338): ("left out: a piece, true: stands alone",),
    ("small", 1000345): ("a report's cost is that of the rows",),
    ("small", 1000346): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000349): ("left out: a piece, true: stands alone",),
    ("small", 1000350): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000351): ("true: not determined",),
    ("small", 1000360): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000364): (
        "a sentence that cannot be checked: Stopped at the limit of iterations before the gradient was small enough.",
        "true: no frame fits the ranges",
    ),
    ("small", 1000367): ("left out: a piece, true: not determined",),
    ("small", 1000371): (
        "a sentence that cannot be checked: Stopped: no step lowers the cost although the gradient is not small; the start may be too far off.",
    ),
    ("small", 1000372): (
        "a sentence that cannot be checked: ModelError: a submap is built from one robot's measurements, found those of .. robots",
    ),
    ("small", 1000380): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000387): (
        "a sentence that cannot be checked: ModelError: submap: member ..: a point.. cannot be the estimate of a pose..",
    ),
    ("small", 1000390): ("exactness is what a step promises",),
    ("small", 1000391): (
        "a converged map is at an optimum",
        "cost is that of the rows",
        "every row comes out",
        "exactness is what a step promises",
        "information is that of the rows",
        "left out: a landmark that its rows leave open",
    ),
    ("small", 1000394): ("true: not determined",),
    ("small", 1000395): ("a sentence that cannot be checked: RuntimeWarning: invalid value encountered in divide",),
    ("small", 1000397): ("left out: a landmark that its rows leave open",),
    ("middle", 1000006): ("true: can still turn",),
    ("plaza2.pyfg", 1000002): ("a map far from the truth says why",),
}
