"""`teamslam convert`: logs from one format to another."""

from pathlib import Path


def convert(input: Path, output: Path, /, *, to: str | None = None, format: str | None = None) -> int:
    """Read a log in one format and write it in another.

    ```
    teamslam convert MRCLAM_Dataset6 my-team --to plain
    teamslam convert robots.g2o team.jrl --to jrl
    ```

    Formats:

    ```
    plain    teamslam's own: a folder with team.toml and CSV files
    g2o      a graph (.g2o), or a folder with one for each robot
    jrl      JSON robot log (.jrl)
    pyfg     PyFG factor graph (.pyfg)
    toro     TORO and iSAM graphs (.graph, .txt)              (read only)
    mrclam   UTIAS MRCLAM data sets                           (read only)
    islsjf   Victoria Park's clean log, runs of I-SLSJF       (read only)
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    input
        A log: a file or folder.
    output
        The file or folder to write; it must not exist.
    to
        The format to write. Without it, told by the ending of the output's name; a name without one: plain.
    format
        The format of the input, where it cannot be told from its looks.
    """
    from teamslam.cli.console import say
    from teamslam.cli.words import counted
    from teamslam.errors import InputError
    from teamslam.io import read, write

    if output.exists():
        raise InputError("the output is there already; choose another name", path=output)
    dataset = read(input, format=format)
    left_out = write(dataset, output, to)
    rows = sum(len(t) for t in dataset.tables)
    say(f"written: {output}: {counted(len(dataset.robots), 'robot', rows, 'measurement')}")
    for note in dataset.notes:
        say(f"read: {note}")
    for dropped in dataset.dropped:
        say(f"dropped in reading: {dropped.count}: {dropped.reason}")
    for dropped in left_out:
        say(f"not as it was in the output: {dropped.count}: {dropped.reason}")
    return 0
