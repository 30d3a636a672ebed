"""`teamslam convert`: logs from one format to another."""

from pathlib import Path


def convert(input: Path, output: Path, /, *, to: str | None = None, format: str | None = None) -> int:
    """Read a log in one format and write it in another.

    ```
    teamslam convert MRCLAM_Dataset6 my-team --to plain
    teamslam convert robots.g2o team.jrl --to jrl
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    input
        A log: a file or folder.
    output
        The file or folder to write; it must not exist.
    to
        The format to write: see the list below. Without it, told by the name of the output.
    format
        The format of the input, where it cannot be told from its looks.
    """
    from teamslam.cli.console import say
    from teamslam.errors import InputError
    from teamslam.io import read, write

    if output.exists():
        raise InputError("the output is there already; choose another name", path=output)
    dataset = read(input, format=format)
    write(dataset, output, to)
    rows = sum(len(t) for t in dataset.tables)
    say(f"written: {output}: {len(dataset.robots)} robots, {rows} measurements")
    for dropped in dataset.dropped:
        say(f"dropped: {dropped.count} rows: {dropped.reason}")
    return 0
