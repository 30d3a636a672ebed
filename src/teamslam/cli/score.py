"""`teamslam score`: a map against the truth, or against another map."""

from pathlib import Path


def score(map: Path, truth: Path, /) -> int:
    """Score a map against the truth after one rigid alignment of the whole team.

    ```
    teamslam score first-map MRCLAM_Dataset6     # against the truth in a log
    teamslam score joined full                   # against another run: how far apart two maps are
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    map
        A run folder, or a file or folder of submaps such as its maps.
    truth
        A log that holds the truth, or another run folder.
    """
    from teamslam.cli.console import say
    from teamslam.cli.sources import maps_in, truth_in
    from teamslam.metrics import score as score_map

    for number, submap in enumerate(maps := maps_in(map), start=1):
        if len(maps) > 1:
            say(f"component {number}:")
        say(str(score_map(submap, truth_in(truth))))
    return 0
