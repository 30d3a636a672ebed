"""KNOWN: logs of the suite that are known to fail, each with what fails of it. Written by `stress.py --known`."""

KNOWN: dict[tuple[str, int], tuple[str, ...]] = {}
