"""How the documentation is built: sphinx-build -W docs docs/_build/html (or: make docs).

The pages are plain Markdown and read as well in the repository; what they say of modules, functions and commands is
written into them by scripts/pages.py. Only their order is told to Sphinx: the lists of index.md become its contents.
"""

import re

from teamslam import __version__

project = "teamslam"
author = "the teamslam authors"
copyright = author
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.mathjax"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
# Links out of docs/ lead to files of the repository.
suppress_warnings = ["config.cache", "myst.xref_missing"]

html_theme = "furo"
html_title = f"teamslam {release}"
html_static_path: list[str] = []


def with_contents(app, docname: str, source: list[str]) -> None:
    """Each list of pages in index.md as a hidden table of contents, called as its heading is."""
    if docname == "index":
        for title, body in re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", source[0], re.DOTALL | re.MULTILINE):
            pages = re.findall(r"^- \[[^\]]+\]\(([\w/]+)\.md\)", body, re.MULTILINE)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n" + "\n".join(pages) + "\n```\n"


def setup(app) -> None:
    """Called by sphinx."""
    app.connect("source-read", with_contents)
