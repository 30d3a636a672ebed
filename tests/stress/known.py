"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {
    ("small", 1000007): ("no map costs more than the optimum from the truth",),
    ("small", 1000044): ("no map costs more than the optimum from the truth", "honest noise is no misfit"),
}
