"""The headings of docs/troubleshooting.md are messages that the source can say."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEADINGS = re.findall(r"^### (.+)$", (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.fixture(scope="module")
def said() -> str:
    """All words in the source that are no docstrings, a line a literal, `…` for what is filled in."""
    return "\n".join(text for path in sorted((ROOT / "src").rglob("*.py")) for text in literals(path))


def literals(path: Path) -> Iterator[str]:
    """The strings of a file as they read where they are shown."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    passed = {id(n.body[0].value) for n in nodes if hasattr(n, "body") and n.body and isinstance(n.body, list)
              and isinstance(n.body[0], ast.Expr)}  # fmt: skip
    passed |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts = (v.value if isinstance(v, ast.Constant) else "…" for v in node.values)
            yield re.sub("…+", "…", "".join(map(str, parts)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            yield node.value


@pytest.mark.parametrize("heading", HEADINGS)
def test_a_heading_is_a_message_that_can_be_said(said: str, heading: str) -> None:
    """Word for word, with anything in place of `…` in either."""
    words = ".{0,60}".join(re.escape(part).replace("'", ".") for part in heading.split("…"))
    assert re.search(words, said), heading


def test_messages_are_told_once() -> None:
    assert len(set(HEADINGS)) == len(HEADINGS) > 30
