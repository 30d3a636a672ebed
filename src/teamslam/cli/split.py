"""`teamslam split`: a log in pieces, each to be built into a submap, here or elsewhere."""

from pathlib import Path

from teamslam.cli.numbers import MaybeWhole


def split(
    log: Path,
    /,
    *,
    out: Path,
    poses_per_piece: MaybeWhole = None,
    keyframe: MaybeWhole = None,
    format: str | None = None,
) -> int:
    """Cut a log into pieces of one robot each, so that each submap is easy to build.

    Every measurement goes into one piece, and consecutive pieces of a robot share a pose.

    ```
    teamslam split MRCLAM_Dataset6 --out pieces
    teamslam build pieces --out submaps
    teamslam join submaps --out map
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    out
        The folder to write, one file *.piece for each; it must not exist or be empty.
    poses_per_piece
        Cut each robot's log after so many poses. Without it a log is one piece, but for gaps in its odometry: the start
        of a long one is found in short stretches by itself.
    keyframe
        Keep only every n-th sighting of each pair of robots.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.console import answer, say
    from teamslam.cli.pieces import pieces_of
    from teamslam.results import refuse_to_overwrite, whole_folder
    from teamslam.results.words import counted
    from teamslam.wire.pieces import write_pieces

    refuse_to_overwrite(out, replace=None)
    pieces = pieces_of(log, format=format, poses_per_piece=poses_per_piece, keyframe=keyframe)
    with whole_folder(out) as draft:
        write_pieces(pieces, draft)
    robots = {piece.tables[0].robot for piece in pieces}
    say(f"written: {out}: {counted(len(pieces), 'piece')} of {counted(len(robots), 'robot')}")
    for dropped in pieces[0].dropped:
        say(f"left out: {dropped.count}: {dropped.reason}")
    answer({"written": str(out), "pieces": len(pieces), "left_out": [vars(d) for d in pieces[0].dropped]})
    return 0
