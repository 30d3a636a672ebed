"""Whether covariances are honest where the model of the data is right, and where it is not: teams with planted faults.

    python benchmarks/calibration.py --teams 50 --right 1000 --out docs/benchmarks/calibration.md
    python benchmarks/calibration.py --teams 100 --fault nothing

Three robots, 120 poses each, 20 landmarks, ranges and bearings in the plane, full least squares. Of each team NEES/dof
of all variables, and of poses and of landmarks one by one; as the noise is stated, calibrated, and by GTSAM's marginals
of the log as it is stated. What is planted is in tests/trust/calibration/faulty.py.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "trust" / "calibration"))

import numpy as np
from faulty import FAULTS, team

from teamslam.config import Config
from teamslam.joining import AtMap
from teamslam.metrics.consistency import ChiSquare
from teamslam.pipeline import Result, run
from teamslam.trust.calibration.estimate import estimate

FIRST, SMALL = 1000, 30
HEAD = """# Calibration

Written by `{command}`.

```text
{what}
```

Means over {teams} teams a fault, NEES/dof: all variables, and poses / landmarks one by one. *inside*: the share of
teams whose NEES of all variables is in the 95 % band of chi-square; *put right*: of teams in which anything was. RMSE
of landmarks, calibrated over as stated.

{right}| planted | as stated | inside | calibrated | inside | GTSAM's marginals | put right | RMSE |
|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Plant, map, count and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, default=20)
    parser.add_argument("--right", type=int, default=0, help="so many small teams with a right model before")
    parser.add_argument("--fault", choices=FAULTS)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = f"python benchmarks/calibration.py --teams {asked.teams}" + (
        (f" --right {asked.right}" if asked.right else "") + (f' --fault "{asked.fault}"' if asked.fault else "")
    )
    what = (__doc__ or "").strip().split("\n\n")[2]
    page = HEAD.format(command=command, what=what, teams=asked.teams, right=right(asked.right) if asked.right else "")
    print(page, end="", flush=True)
    for line in rows([asked.fault] if asked.fault else list(FAULTS), asked.teams):
        print(line, flush=True)
        page += line + "\n"
    if asked.out:
        asked.out.write_text(page)


def right(teams: int) -> str:
    """What comes of teams with a right model, by default."""
    looked_at, changed, found = 0, 0, []
    for seed in range(teams):
        log = team(seed, poses=SMALL)
        result = run(log, Config(method="full"))
        changed += bool(result.calibration)
        looked_at += bool(result.calibration) or estimate(AtMap(log.tables, result.map)) is not None
        consistency = result.scores[0].consistency
        assert consistency is not None
        found.append(consistency.nees)
    whole = ChiSquare(sum(nees.value for nees in found), sum(nees.dof for nees in found))
    low, high = whole.band or (np.nan, np.nan)
    inside = np.mean([bool(nees.inside) for nees in found])
    off = 1.96 * np.sqrt(0.95 * 0.05 / teams)
    return f"""Right models, by default, {teams:,} teams of {SMALL} poses a robot: NEES/dof of all together
{whole.per_dof:.4f} (95 % band {low:.4f} to {high:.4f}); {inside:.1%} of the teams inside their own
({0.95 - off:.1%} to {0.95 + off:.1%} by chance). The screen had {looked_at / teams:.1%} looked at more closely, and
{changed / teams:.1%} were changed.

"""


def rows(faults: list[str], teams: int) -> Iterator[str]:
    """A row of the table for each fault."""
    from peers.gtsam_marginals import nees

    for fault in faults:
        stated, calibrated, theirs = [], [], []
        for seed in range(FIRST, FIRST + teams):
            log = FAULTS[fault](team(seed), np.random.default_rng(seed))
            stated.append(run(log, Config(method="full", calibrate=False)))
            calibrated.append(run(log, Config(method="full")))
            assert log.truth is not None
            theirs.append(nees(log, log.truth.only(log.layout.keys), stated[-1].map.base))
        changed = np.mean([bool(result.calibration) for result in calibrated])
        ratio = np.mean([r.scores[0].landmark_rmse_m for r in calibrated]) / np.mean(
            [r.scores[0].landmark_rmse_m for r in stated]
        )
        ours = " | ".join(f"{_means(results)} | {_inside(results):.0%}" for results in (stated, calibrated))
        gtsam = " / ".join(f"{x:.2f}" for x in np.mean(theirs, 0))
        yield f"| {fault} | {ours} | {gtsam} | {changed:.0%} | {ratio:.2f} |"


def _means(results: list[Result]) -> str:
    found = [result.scores[0].consistency for result in results]
    known = [c for c in found if c is not None and c.of_poses is not None and c.of_landmarks is not None]
    numbers = [
        (c.nees.per_dof, c.of_poses.per_dof, c.of_landmarks.per_dof) for c in known if c.of_poses and c.of_landmarks
    ]
    whole, poses, landmarks = np.mean(np.array(numbers, float), 0)
    return f"{whole:.2f}, {poses:.2f} / {landmarks:.2f}"


def _inside(results: list[Result]) -> float:
    return float(np.mean([bool(c.nees.inside) for r in results if (c := r.scores[0].consistency) is not None]))


if __name__ == "__main__":
    main()
