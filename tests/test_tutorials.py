"""Pages that one follows step by step: what they tell to run runs, and prints what they say.

In each, blocks are gone through in order, in an empty folder. A block of `sh` is run; one of Python or TOML whose first
line is a comment that names a file is saved as that; any other Python is run. Each line of a block of `text` must be in
what was printed, or in a file that was written, by then. What follows `<!-- not run -->` is passed over.
"""

import contextlib
import io
import re
import runpy
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from teamslam.cli import main

DOCS = Path(__file__).parents[1] / "docs"
PAGES = ("tutorial", "covariances", "from_gtsam", "from_ros")
NEEDS = {"from_gtsam": "gtsam", "from_ros": "rosbags"}
BLOCK = re.compile(r"(<!-- not run -->\s*)?^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVED_AS = re.compile(r"# ([\w./-]+\.(?:py|toml|csv|yaml))\b")


@pytest.mark.parametrize("page", PAGES)
def test_following_a_page_gives_what_it_says(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page in NEEDS:
        pytest.importorskip(NEEDS[page])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    reader = Reader()
    for passed_over, language, block in BLOCK.findall((DOCS / f"{page}.md").read_text(encoding="utf-8")):
        if not passed_over:
            reader.follow(language, block)
    assert reader.ran


@dataclass
class Reader:
    """Who follows a page: what was printed so far, and how much was run."""

    printed: str = ""
    ran: int = 0

    def follow(self, language: str, block: str) -> None:
        """One block."""
        name = SAVED_AS.match(block)
        if language in ("python", "toml") and name:
            Path(name[1]).parent.mkdir(parents=True, exist_ok=True)
            Path(name[1]).write_text(block, encoding="utf-8")
        elif language == "python":
            Path("block.py").write_text(block, encoding="utf-8")
            self.run("python block.py")
        elif language == "sh":
            for line in block.strip().split("\n"):
                self.run(line)
        elif language == "text":
            files = [path for path in Path().rglob("*.*") if path.suffix in (".csv", ".yaml", ".tum", ".g2o")]
            known = " ".join([self.printed, *(path.read_text(encoding="utf-8") for path in files)])
            known = re.sub(r"\s+", " ", known)
            for line in block.strip().split("\n"):
                assert re.sub(r"\s+", " ", line.strip()) in known, f"nothing said: {line}"

    def run(self, line: str) -> None:
        """A line of a shell, within this process."""
        command, *words = shlex.split(line, comments=True)
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            if command == "teamslam":
                code = called(words)
            elif command == "python":
                runpy.run_path(words[0], run_name="__main__")
                code = 0
            else:
                assert command == "mkdir", line
                code = Path(words[-1]).mkdir(parents=True)
        self.printed += out.getvalue()
        self.ran += 1
        assert not code, f"{line}: exit code {code}\n{out.getvalue()}"


def called(words: list[str]) -> int:
    """A command's exit code, whether it returns it or exits."""
    try:
        return main(words)
    except SystemExit as end:
        return int(end.code or 0)
