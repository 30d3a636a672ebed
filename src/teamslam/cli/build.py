"""`teamslam build`: submaps from a log or from pieces of one (Algorithm 1)."""

from pathlib import Path

from teamslam.cli.numbers import MaybeWhole, Whole


def build(
    *inputs: Path,
    out: Path,
    version: Whole = 0,
    poses_per_piece: MaybeWhole = None,
    calibrate: bool = True,
    format: str | None = None,
) -> int:
    """Build a submap of every piece of a log, each in its own frame.

    Where a piece shows that its noise is not as stated, that is put right, so that what a robot sends claims no more
    than it knows; how sensors of robots differ is seen only when a team's log is mapped as one (`teamslam run`).

    ```
    teamslam build MRCLAM_Dataset6 --out submaps
    teamslam build pieces --out submaps
    teamslam build pieces/1_robot_1.piece pieces/2_robot_1.piece --out robot-1
    ```

    Exit codes: 0 done; 1 some piece was refused or gave no submap (the others are written); 2 bad input or usage;
    4 none gave one.

    Parameters
    ----------
    inputs
        One log, or pieces as `teamslam split` writes them: files, or folders of them.
    out
        The folder to write, one file *.submap for each; it must not exist or be empty.
    version
        The version of the submaps. In a join a newer version of a submap replaces an older one.
    poses_per_piece
        Cut each robot's log after so many poses. Without it a log is one piece, but for gaps in its odometry.
    calibrate
        Put right what a piece shows to be wrong with its noise (the default). --no-calibrate takes it as stated.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, complain, progress_bar, say
    from teamslam.cli.pieces import pieces_in
    from teamslam.errors import InputError, SolveError
    from teamslam.io import write_submaps
    from teamslam.joining import build as build_submap
    from teamslam.results import refuse_to_overwrite, whole_folder
    from teamslam.results.words import counted
    from teamslam.trust.calibration import honest, sentences

    refuse_to_overwrite(out, replace=None)
    if version < 0:
        raise InputError(f"versions of submaps are counted from 0, found {version}", field="version")
    pieces, damaged = pieces_in(inputs, format, poses_per_piece)
    for reason in damaged:
        complain(f"refused: {reason}")
    if not pieces:
        raise InputError("none of these pieces can be built; see the reasons above")
    submaps, failed, told = [], len(damaged), {}
    with progress_bar() as progress:
        for number, piece in enumerate(pieces, 1):
            try:
                submap = build_submap(piece, version=version)
                if calibrate:
                    submap, found = honest(submap, piece)
                    told[submap.id] = sentences(found)
                submaps.append(submap)
            except SolveError as error:
                failed += 1
                complain(f"piece {number} of {len(pieces)} gave no submap: {error}")
            progress("building submaps", number, len(pieces))
    if not submaps:
        raise SolveError("no piece gave a submap; see the reasons above")
    with whole_folder(out) as draft:
        write_submaps(submaps, draft)
    robots = {robot for submap in submaps for robot in submap.robots}
    for submap in submaps:
        if not submap.dof:
            alone = submap.names.describe(submap.base)
            say(f"submap {submap.id} is {alone} alone; its rows travel with it, and what others know may place it")
    for name, put_right in told.items():
        for sentence in put_right:
            say(f"put right in submap {name}: {sentence}")
    say(f"written: {out}: {counted(len(submaps), 'submap')} of {counted(len(robots), 'robot')}")
    answer({"written": str(out), "submaps": [s.id for s in submaps], "failed": failed, "put_right": told})
    return PARTLY if failed else DONE
