"""`teamslam score`: a map against the truth, or against another map."""

from pathlib import Path


def score(map: Path, truth: Path, /) -> int:
    """Score a map against the truth after one rigid alignment of the whole team.

    ```
    teamslam score first-map MRCLAM_Dataset6     # against the truth in a log
    teamslam score first-map truth               # against TUM files, one a robot, called as the robots are
    teamslam score first-map truth_robots.csv    # against a CSV: robot, stamp and pose, or landmark and place
    teamslam score estimate.tum truth.tum        # of what another program found
    teamslam score joined full                   # against another run: how far apart two maps are
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    map
        A run folder, or a file or folder of submaps such as its maps; or a file of an estimate alone (TUM, CSV, JRR).
    truth
        A log that holds the truth; TUM files or a CSV file of true poses or places; or another run folder.
    """
    from dataclasses import replace

    from teamslam.cli.console import answer, say
    from teamslam.cli.sources import maps_in, truth_in
    from teamslam.metrics import errors_of
    from teamslam.metrics import score as score_map
    from teamslam.solver import Covariances

    maps, known = maps_in(map), truth_in(truth)
    if known.is_map:
        say(f"{truth} holds no truth but another map: these are differences, not errors")
    reports = []
    for number, submap in enumerate(maps, start=1):
        if submap.information.nnz:
            found = score_map(submap, known.of(submap), covariances=Covariances.of_map(submap))
        else:
            found = errors_of(submap, known.of(submap))
        if known.is_map:  # made of the same measurements, perhaps: its covariances say nothing about the difference
            found = replace(found, consistency=None)
        reports.append(found.to_dict())
        say(f"component {number}: {found}" if len(maps) > 1 else str(found))
    answer({"truth": str(truth), "is_map": known.is_map, "components": reports})
    return 0
