"""What the README and the pages in docs/ say of modules, functions, commands and measurements, taken from these.

    python scripts/pages.py            writes it into README.md and docs/*.md, between the marks
    python scripts/pages.py --check    writes nothing; exit code 1 and the names of pages that are not as they would be

A mark is a comment, which a reader of Markdown never sees; all from it to `<!-- end -->` is written by this script:

    <!-- module teamslam.io.formats -->              the module's docstring
    <!-- object teamslam.io.read -->                 a function, or a class with its methods, under a heading of its own
    <!-- facts teamslam.io.Options -->               a class without its methods
    <!-- command run -->                             a command's help: what it does, examples, arguments
    <!-- string examples/02_own_data.py TEAM_TOML toml -->     a string of a script, as it stands
    <!-- headline docs/benchmarks/calibration_logs.md -->      the README's table, from that page's

Docstrings are laid out for the eye. Prose becomes prose; what is indented, or lines up in columns, stays as it is.
"""

import ast
import enum
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
MARK = re.compile(r"<!-- (module|object|facts|command|string|headline) ([^>]+?) -->\n.*?<!-- end -->", re.DOTALL)
COLUMNS = re.compile(r"\S {2,}\S")
WIDE = 100
HEADLINE_COLUMNS, HEAD_ROWS = 9, 2
STATED = "the same with `--no-calibrate`"
METHODS = {"join": "--out joined", "exact": "--out exact --exact", "full": "--out full --method full"}


def main(arguments: list[str]) -> int:
    """Write the pages, or say which are not as they would be written."""
    stale = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        before = page.read_text(encoding="utf-8")
        after = written(before)
        if after != before:
            stale.append(page.relative_to(ROOT).as_posix())
            if "--check" not in arguments:
                page.write_text(after, encoding="utf-8")
    for name in stale:
        print(
            f"{name}: {'not as docstrings say; run: python scripts/pages.py' if '--check' in arguments else 'written'}"
        )
    return int(bool(stale) and "--check" in arguments)


def written(page: str) -> str:
    """A page with all that stands between its marks written anew."""

    def filled(mark: re.Match[str]) -> str:
        kind, words = mark.groups()
        return f"<!-- {kind} {words} -->\n\n{KINDS[kind](*words.split()).strip()}\n\n<!-- end -->"

    return MARK.sub(filled, page)


def module(name: str) -> str:
    """A module's docstring."""
    return in_markdown(import_module(name).__doc__)


def an_object(name: str) -> str:
    """A function or a class, and the public methods of that."""
    return "\n\n".join([facts(name), "\n".join(_methods(named(name)))])


def facts(name: str) -> str:
    """A function or a class by itself."""
    found = named(name)
    text = found.__doc__ if not isinstance(found, type) or found.__doc__ != type.__doc__ else ""
    call = [f"```python\n{signature(found, found.__name__)}\n```"] if not isinstance(found, enum.EnumMeta) else []
    return "\n\n".join([f"### {shortest(name)}", *call, in_markdown(text)])


def command(name: str) -> str:
    """A command's help: of its docstring what stands before its parameters, then the arguments as a table."""
    from teamslam.cli.app import app

    found = app
    for word in name.split("/"):
        found = found[word]
    asked = found.default_command
    rows = [row for argument in found.assemble_argument_collection() if (row := _argument(argument, asked))]
    text = re.split(r"\n\s*Parameters\s*\n\s*-+", inspect.cleandoc(asked.__doc__))[0]
    table = "\n".join(["| argument | |", "|---|---|", *rows])
    return f"{in_markdown(text)}\n\n{table}"


def string(path: str, name: str, language: str) -> str:
    """A string that a script assigns to a name."""
    for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", None) == name:
            return f"```{language}\n{ast.literal_eval(node.value).strip()}\n```"
    raise LookupError(f"{path} assigns no string to {name}")


def headline(path: str) -> str:
    """What a run of each log gives, calibrated and as its noise is stated: a row for each pair of rows there."""
    columns = ("command", "robots' position RMSE", "landmarks' RMSE", "NEES / dof, all / landmarks", STATED)
    head = f"| {' | '.join(columns)} |"
    cells = [line.strip("|").split("|") for line in (ROOT / path).read_text(encoding="utf-8").split("\n")]
    rows = [[cell.strip() for cell in row] for row in cells if len(row) == HEADLINE_COLUMNS][HEAD_ROWS:]
    lines = [_headline_row(*pair) for pair in zip(rows[::2], rows[1::2], strict=True)]
    return "\n".join([head, "|---|---|---|---|---|", *lines])


def _headline_row(stated: list[str], calibrated: list[str]) -> str:
    log, method = stated[0].split(", ")
    robots, landmarks, nees = _headline_figures(calibrated)
    command = f"teamslam run {log} {METHODS[method]}"
    as_stated = ", ".join(filter(None, _headline_figures(stated)))
    return f"| `{command}` | {robots or 'no truth'} | {landmarks} | {nees} | {as_stated} |"


def _headline_figures(row: list[str]) -> tuple[str, str, str]:
    robots, landmarks = row[7].split(",")
    metres = [f"{float(error):.3f} m" if error.strip() else "" for error in (robots, landmarks)]
    nees = [f"{float(row[6]):.2f}"] * bool(metres[0]) + [f"{float(row[2]):.2f}"]
    return metres[0], metres[1], " / ".join(nees)


KINDS: dict[str, Callable[..., str]] = {
    "module": module,
    "object": an_object,
    "facts": facts,
    "command": command,
    "string": string,
    "headline": headline,
}


def named(name: str) -> Any:
    """What a dotted name stands for."""
    home, _, last = name.rpartition(".")
    return getattr(import_module(home), last)


def shortest(name: str) -> str:
    """How a script would say it: `ts.read` where teamslam itself offers it."""
    import teamslam

    last = name.rpartition(".")[2]
    return f"`ts.{last}`" if last in teamslam.__all__ else f"`{name}`"


def signature(found: Any, name: str) -> str:
    """A call as it is written, with types and defaults, over several lines where it is long."""
    try:
        whole = inspect.signature(found)
    except (TypeError, ValueError):
        return name
    parameters = [p for p in whole.parameters.values() if p.name != "self" and not p.name.startswith("_")]
    words = list(_words(parameters))
    gives = "" if isinstance(found, type) else _type(whole.return_annotation)
    end = f" -> {gives}" if gives else ""
    line = f"{name}({', '.join(words)}){end}"
    return line if len(line) <= WIDE else f"{name}(\n" + "".join(f"    {word},\n" for word in words) + f"){end}"


def _words(parameters: list[inspect.Parameter]) -> Iterator[str]:
    keyword = False
    for one in parameters:
        if one.kind is one.KEYWORD_ONLY and not keyword:
            yield "*"
        keyword |= one.kind in (one.KEYWORD_ONLY, one.VAR_POSITIONAL)
        stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        kind = _type(one.annotation)
        default = "" if one.default is one.empty else f" = {_default(one.default)}"
        yield f"{stars}{one.name}{f': {kind}' if kind else ''}{default if kind else default.replace(' ', '')}"


def _type(annotation: Any) -> str:
    if annotation is inspect.Parameter.empty:
        return ""
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
    if not isinstance(annotation, str) and ("[" in str(annotation) or "|" in str(annotation) or not text):
        text = str(annotation)
    text = re.sub(r"[\w.]+\.(\w+)", r"\1", text.strip("'\"")).replace("'", "")
    return re.sub(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+?)_?(?:64|32|8)?\]\]", _array, text)


def _array(found: re.Match[str]) -> str:
    return {"float": "Array", "int": "IntArray", "bool": "BoolArray"}.get(found[1], found[0])


def _default(value: Any) -> str:
    plain = value is None or isinstance(value, bool | int | float | str | enum.Enum) or value == ()
    if isinstance(value, enum.Enum):
        return str(value)
    return (f'"{value}"' if isinstance(value, str) else repr(value)) if plain else "..."


def _methods(found: Any) -> Iterator[str]:
    """The public methods and properties of a class, each with its first sentences."""
    if not isinstance(found, type) or isinstance(found, enum.EnumMeta):
        return
    for name, value in vars(found).items():
        call = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        text = inspect.getdoc(call) if not name.startswith("_") else None
        asked = inspect.isfunction(call) or hasattr(call, "func") or hasattr(call, "fget")
        if not text or isinstance(value, type) or not asked:
            continue
        shown = signature(call, name) if inspect.isfunction(call) else name
        shown = re.sub(r"\(cls(, )?", "(", re.sub(r"\s+", " ", shown)).replace("( ", "(").replace(", )", ")")
        yield f"- **`{shown}`** {_line(text)}"


def _line(text: str) -> str:
    """A docstring as one item of a list: its first paragraph."""
    return escaped(re.sub(r"\s*\n\s*", " ", text.split("\n\n")[0]))


def _argument(argument: Any, asked: Any) -> str | None:
    """A row of a command's arguments; the options of every command are told once, above."""
    if not argument.show or argument.names[0] in ("--quiet", "--verbose", "--json"):
        return None
    names = ", ".join(f"`{name}`" for name in argument.names)
    meaning = re.sub(r"\s+", " ", argument.parameter.help or _parameter(asked, argument.field_info.name)).strip()
    return f"| {names} | {escaped(meaning).replace('|', chr(92) + '|')} |"


def _parameter(asked: Any, name: str) -> str:
    """What a docstring says of a parameter."""
    text = inspect.cleandoc(asked.__doc__)
    found = re.search(rf"^{name}\n((?:[ \t]+\S.*\n?|\n(?=[ \t]))+)", text, re.MULTILINE)
    return found[1] if found else ""


def in_markdown(text: str | None) -> str:
    """A docstring as Markdown: prose as prose, what lines up in columns as it is."""
    parts: list[tuple[bool, str]] = []
    for block in blocks(inspect.cleandoc(text or "")):
        if all(line.lstrip().startswith("|") for line in block.split("\n")):
            parts.append((False, inspect.cleandoc(block)))
            continue
        drawn = is_drawn(block)
        if drawn and parts and parts[-1][0]:
            parts[-1] = (True, f"{parts[-1][1]}\n\n{block}")
        else:
            parts.append((drawn, block))
    as_it_is = ("```", "|")
    return "\n\n".join(
        fenced(block) if drawn else block if block.startswith(as_it_is) else escaped(block) for drawn, block in parts
    )


def blocks(text: str) -> Iterator[str]:
    """Parts between blank lines; what is fenced already is one."""
    for number, part in enumerate(re.split(r"(^```.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)):
        yield from (
            [part] if number % 2 else (block for block in re.split(r"\n\s*\n", part.strip("\n")) if block.strip())
        )


def is_drawn(block: str) -> bool:
    """Whether a block is laid out by spaces: indented, or in columns."""
    if block.startswith("```"):
        return False
    lines = block.split("\n")
    return lines[0].startswith("    ") or any(COLUMNS.search(line) for line in lines)


def fenced(block: str) -> str:
    """A block as it is written."""
    lines = block.split("\n")
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
    return "```text\n" + "\n".join(line[margin:].rstrip() for line in lines) + "\n```"


def escaped(block: str) -> str:
    """Prose in which nothing outside of backticks is taken for markup."""
    parts = re.split(r"(`[^`\n]*(?:\n[^`\n]*)?`)", block)
    for place in range(0, len(parts), 2):
        text = re.sub(r"(?<!\\)([*<])", r"\\\1", parts[place])
        text = re.sub(r"(?<!\w)_(?=\w)|(?<=\w)_(?!\w)", r"\\_", text)
        parts[place] = re.sub(r"\](?=[(\[])", r"\\]", re.sub(r"^(\s*)([#>])", r"\1\\\2", text, flags=re.MULTILINE))
    return "".join(parts)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
