"""How the documentation is built: sphinx-build -W docs docs/_build/html (or: make docs)."""

from teamslam import __version__

project = "teamslam"
author = "the teamslam authors"
copyright = author
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx.ext.viewcode"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["config.cache"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
add_module_names = False
# Docstrings are plain text with tables and formulas that line up: shown as they are written.
autodoc_default_options = {"members": True}

html_theme = "furo"
html_title = f"teamslam {release}"
html_static_path: list[str] = []


def as_written(app, what, name, obj, options, lines: list[str]) -> None:
    """Docstrings as literal blocks: they are laid out for the eye, not for a markup language."""
    if any(line.strip() for line in lines):
        lines[:] = ["::", "", *("    " + line for line in lines), ""]


def setup(app) -> None:
    """Called by sphinx."""
    app.connect("autodoc-process-docstring", as_written)
