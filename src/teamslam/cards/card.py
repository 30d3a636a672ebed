"""A card: a title, a picture, some facts and a sentence, as HTML that stands by itself."""

from collections.abc import Iterable
from html import escape

from teamslam.errors import in_words

LONGEST = 400  # letters of one fact


def card(title: str, facts: Iterable[tuple[str, str]] = (), *, picture: str = "", sentence: str = "") -> str:
    """HTML of a card; `picture` is SVG as `picture` draws it, everything else is plain words."""
    rows = "".join(
        f'<tr><td style="text-align:left;opacity:.65;padding:0 1em 0 0">{_words(name)}</td>'
        f'<td style="text-align:left;padding:0">{_words(value)}</td></tr>'
        for name, value in facts
    )
    said = f'<div style="margin-top:.3em">{_words(sentence)}</div>' if sentence else ""
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start;font-size:90%">'
        f"{picture}<div><b>{_words(title)}</b>"
        f'<table style="border:none;margin:.3em 0 0 0">{rows}</table>{said}</div></div>'
    )


def _words(text: str) -> str:
    shown = in_words(text)
    return escape(shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 3]}...")
