"""What is said of a cell that should hold a number and does not."""

import re

LONGEST = 40
DATE = re.compile(r"(\d{4}-\d\d?-\d\d?|\d{1,4}[./]\d\d?[./]\d{1,4})([T ]+\d\d?:\d\d|$)")
CLOCK = re.compile(r"\d\d?:\d\d(:\d\d([.,]\d*)?)?( ?[AaPp]\.?[Mm]\.?)?$")


def no_number(cell: str) -> str:
    """What was found in place of a number, with its cure where it looks like one that was written in another way."""
    shown = cell if len(cell) <= LONGEST else cell[: LONGEST - 3] + "..."
    cure = ""
    if cell.count(",") == 1:
        cure = " (decimal commas are not read: write a point)"
    elif DATE.match(cell) or CLOCK.match(cell):
        pandas = "pandas' (t - t[0]).dt.total_seconds() does"
        cure = f" (dates and times of day are not read: write seconds since any start, as {pandas})"
    return f"expected a number, found '{shown}'{cure}"
