"""Pages: words come out as words whatever they are, arrays come back, and what is thinned is near what is drawn."""

import base64
import json
import re
from html import escape
from html.parser import HTMLParser

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from strategies import generators
from teamslam.report import Marks, Page, Part, Rows, Sightings, Table, Way, evenly, html_of, within
from teamslam.report.tables import list_html

WORDS = st.one_of(
    st.text(min_size=1, max_size=30),
    st.sampled_from(
        ["</script><b>", "$x{$", "<!--data-->", "/*script*/", "&amp;", "\u2028", '"', "\\u003c", "]]>", "\0"]
    ),
)


class Reader(HTMLParser):
    """What a browser finds in a page: the text of each element, and the scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.inside: list[str] = []
        self.text: list[str] = []
        self.scripts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Deeper."""
        self.inside.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        """Out again."""
        self.inside.append("")

    def handle_data(self, data: str) -> None:
        """Text, or a script's."""
        if self.inside and self.inside[-1] == "script":
            self.scripts[-1] += data
        else:
            self.text.append(data)


def page_with(word: str, places: np.ndarray) -> Page:
    """A page that has a word wherever words stand, and a robot's way."""
    count = len(places)
    far = np.full((1, 3), 1e6)
    way = Way(0, count, np.arange(count) * 0.5, places, np.tile([1.0, 0.0, 0.0], (count, 1)), 0.0 * places, np.zeros(0),
              np.zeros((0, 3, 3)))  # fmt: skip
    marks = Marks([word], places[:1], np.eye(3)[None], far, np.full((1, 3), np.nan), np.zeros(1, bool))
    nobody = Sightings(np.zeros((0, 2), np.int64), np.zeros((0, 2)))
    part = Part(word, word, False, 1, 5.99, [way], marks, nobody, np.zeros((0, 2, 3)), 1)
    rows = Rows(0, 0, word, np.zeros(1), np.ones(1), np.zeros(1, np.int64))
    table = Table(word, (word,), [[word]], word)
    return Page(word, "fits", word, [(word, word)], [word], ("#123456",), False, [part], [rows], [table], word, [word])


@given(WORDS)
def test_words_stay_words(word: str) -> None:
    """No name ends a script, opens an element or fills a hole of the template; the data reads back to the letter."""
    page = html_of(page_with(word, np.zeros((3, 3))))
    plain = html_of(page_with("a", np.zeros((3, 3))))
    assert page.count("<script") == plain.count("<script") == 2
    found, empty = Reader(page), Reader(plain)
    assert len(found.inside) == len(empty.inside)
    data = json.loads(found.scripts[0])
    assert data["robots"] == [word] and data["parts"][0]["marks"]["names"] == [word]
    assert data["rows"][0]["source"] == word and data["parts"][0]["title"] == word
    shown = word.replace("\r\n", "\n").replace("\r", "\n")
    assert "\0" in word or shown.strip() in "".join(found.text).replace("\r\n", "\n").replace("\r", "\n")


@given(generators)
def test_arrays_come_back_near_a_far_origin(rng: np.random.Generator) -> None:
    """Places a million metres out, in 32 bits, to a tenth of a millimetre a hundred metres about."""
    places = np.array([5e5, 4e6, 100.0]) + rng.uniform(-50.0, 50.0, (20, 3))
    data = json.loads(Reader(html_of(page_with("a", places))).scripts[0])
    part = data["parts"][0]
    back = np.frombuffer(base64.b64decode(part["ways"][0]["p"]), "<f4").reshape(-1, 3) + np.array(part["origin"])
    np.testing.assert_allclose(back, places, atol=1e-4)


@given(generators, st.integers(1, 200), st.floats(1e-3, 10.0))
def test_no_pose_is_far_from_what_is_drawn(rng: np.random.Generator, count: int, step_m: float) -> None:
    """The law of `within`; the ends stay, and there are no more than the way is long in steps, and two."""
    places = np.cumsum(rng.standard_normal((count, 3)) * rng.choice([0.0, 1.0], (count, 1)), axis=0)
    kept = within(places, step_m)
    stands_for = kept[np.searchsorted(kept, np.arange(count), side="right") - 1]
    assert np.linalg.norm(places - places[stands_for], axis=-1).max() <= step_m + 1e-9
    assert kept[0] == 0 and kept[-1] == count - 1
    length = np.linalg.norm(np.diff(places, axis=0), axis=-1).sum()
    assert len(kept) <= length / step_m + 3


@given(generators, st.integers(1, 500), st.integers(1, 100))
def test_the_worst_rows_are_drawn(rng: np.random.Generator, count: int, most: int) -> None:
    """Among about `most`, the largest; all where they are no more."""
    size = rng.exponential(size=count)
    kept = evenly(size, most)
    assert kept[np.argmax(size)] and kept.sum() <= most + max(most // 20, 1)
    assert count > most or kept.all()


@given(st.lists(st.tuples(st.sampled_from(["cost", "put right", ""]), WORDS), max_size=12))
def test_a_list_keeps_every_value_in_order_and_folds_what_is_many(rows: list[tuple[str, str]]) -> None:
    """Names stand once for values that follow each other; a fold says how many it holds."""
    values = [value for _, value in rows]
    html = list_html(rows)
    assert re.findall(r"<dd>((?:(?!<details>).)*?)</dd>", html, re.DOTALL) == [escape(value) for value in values]
    names = [name for name, _ in rows]
    runs = [name for n, name in enumerate(names) if n == 0 or name not in ("", _before(names, n))]
    assert re.findall("<dt>(.*?)</dt>", html) == runs
    for count, folded in re.findall(r"<summary>and (\d+) more</summary>(.*?)</details>", html, re.DOTALL):
        assert int(count) == folded.count("<dd>") > 1


def _before(names: list[str], n: int) -> str:
    """The name that goes on above a row."""
    return next((name for name in reversed(names[:n]) if name), names[0])
