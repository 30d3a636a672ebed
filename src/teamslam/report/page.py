"""The page itself, from top to bottom: verdict, map, errors, residuals, links and losses, how it was made.

Everything that is told in words stands in the HTML and is read without a script; the script draws. The page asks
nothing of any network, and its content policy forbids it to.
"""

import re
from base64 import b64encode
from html import escape
from importlib.resources import files

from teamslam.report.contents import Page
from teamslam.report.packing import script_json
from teamslam.report.tables import list_html, table_html

HOLE = re.compile(r"<!--(\w+)-->|/\*(\w+)\*/")


def html_of(page: Page) -> str:
    """The page as HTML. Law: whatever the words of a run are, they come out as words."""
    parts = {
        "title": escape(page.title),
        "style": _ours("page.css"),
        "level": escape(page.verdict),
        "sentence": escape(page.sentence),
        "alerts": "".join(f'<p class="alert">{escape(alert)}</p>' for alert in page.alerts),
        "summary": list_html(page.summary),
        "thinned": "".join(f'<p class="note">{escape(line)}</p>' for line in page.thinned),
        "pictures": "".join(_picture(title, png) for title, png in page.pictures),
        "tables": "\n".join(map(table_html, page.tables)),
        "config": escape(page.config),
        "data": script_json(page),
        "script": _ours("page.js"),
    }
    return HOLE.sub(lambda hole: parts[hole[1] or hole[2]], _ours("page.html"))


def _picture(title: str, png: bytes) -> str:
    return f'<h2>{escape(title)}</h2><img alt="{escape(title)}" src="data:image/png;base64,{b64encode(png).decode()}">'


def _ours(name: str) -> str:
    return files("teamslam.report").joinpath(name).read_text(encoding="utf-8")
