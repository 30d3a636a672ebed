"""Tables and lists as HTML: every word escaped, numbers to the right, bars where a column is to be compared."""

from collections.abc import Iterator, Sequence
from html import escape

from teamslam.report.contents import Table

UNFOLDED = 3  # values of one name that stand in a list before the others are folded
SHORT = 18  # letters of a cell that is not broken into lines


def table_html(table: Table) -> str:
    """A table with its title and its note; one that is `folded` opens when it is asked for, and when it is printed."""
    inside = f'<div class="wide"><table><thead><tr>{_heads(table)}</tr></thead><tbody>'
    inside += "".join(_rows(table)) + "</tbody></table></div>"
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    kind = ' class="full"' if len(table.columns) > 6 else ""
    if table.folded:
        title = f"{escape(table.title)} ({len(table.rows):,})"
        return f"<details{kind}><summary>{title}</summary>{note}{inside}</details>"
    return f"<div{kind}><h3>{escape(table.title)}</h3>{note}{inside}</div>"


def list_html(rows: Sequence[tuple[str, str]]) -> str:
    """Names and values; what has no name, or the same, goes on with what stands above it.

    Of many values of one name the first stand there, the others open when asked for, and when the page is printed.
    """
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt>{_values(values)}" for name, values in _by_name(rows)) + "</dl>"


def _by_name(rows: Sequence[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    groups: list[tuple[str, list[str]]] = []
    for name, value in rows:
        if groups and name.strip() in ("", groups[-1][0]):
            groups[-1][1].append(value)
        else:
            groups.append((name.strip(), [value]))
    return groups


def _values(values: Sequence[str]) -> str:
    shown = len(values) if len(values) <= UNFOLDED + 1 else UNFOLDED
    lines = [f"<dd>{escape(value)}</dd>" for value in values]
    more = f"<dd><details><summary>and {len(values) - shown} more</summary>{''.join(lines[shown:])}</details></dd>"
    return "".join(lines[:shown]) + (more if shown < len(values) else "")


def _rows(table: Table) -> Iterator[str]:
    longest = max((_number(row[table.bars]) or 0.0 for row in table.rows), default=0.0) if table.bars is not None else 0
    for row in table.rows:
        cells = _cells(row)
        if table.bars is not None and longest > 0.0:
            share = (_number(row[table.bars]) or 0.0) / longest
            cells += f'<td class="bar"><span style="width:{100.0 * share:.1f}%"></span></td>'
        yield f"<tr>{cells}</tr>"


def _heads(table: Table) -> str:
    """The columns' names, above numbers to the right as these are."""
    first = table.rows[0] if table.rows else table.columns
    sides = [_side(cell) for cell in first] + [""] * (len(table.columns) - len(first))
    return "".join(f"<th{side}>{escape(name)}</th>" for name, side in zip(table.columns, sides, strict=True))


def _cells(cells: Sequence[str]) -> str:
    return "".join(f"<td{_side(cell)}>{escape(cell)}</td>" for cell in cells)


def _side(cell: str) -> str:
    if _number(cell) is not None:
        return ' class="number"'
    return ' class="short"' if len(cell) <= SHORT else ""


def _number(cell: str) -> float | None:
    try:
        return float(cell.replace(",", "").rstrip("%"))
    except ValueError:
        return None
