"""How many teams can be within their own band where how large odometry's errors are is told by the team's data alone.

    python benchmarks/calibration_bound.py --teams 10 --out docs/benchmarks/calibration_bound.md

Three robots, 120 poses each, odometry's sigmas stated a third of what they are. With A the restricted information of
phi, the logarithms of what is free of odometry's variances, and S the covariance of n unknowns by the noise found,

    w_k  =  tr(S^-1 dS/dphi_k) / n ,     sd of NEES/dof  =  (2 / n + w' A^-1 w)^1/2

and of Gaussian ones P(|N| < 1.96 (2 / n)^1/2 / sd) are inside the band of chi-square. No unbiased estimate of phi from
one team's data does better (Cramer and Rao), and no widening of S does: it moves the NEES of all teams alike.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "trust" / "calibration"))

import numpy as np
from faulty import misstated, team
from scipy.stats import norm

from teamslam.geometry import Array
from teamslam.joining import AtMap, full
from teamslam.model import Dataset
from teamslam.trust.calibration.components import Components
from teamslam.trust.calibration.estimate import searched
from teamslam.trust.calibration.rows import linear_at

FIRST, STEP = 1000, 0.01


def main() -> None:
    """Of each team the deviation of NEES/dof, by chi-square alone and with how odometry's variances are known."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, default=10)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    logs = (misstated(team(FIRST + k), 1.0 / 3.0, odometry=True) for k in range(asked.teams))
    deviations = np.array([spread(log) for log in logs])
    alone, whole = deviations.mean(0)
    inside = np.mean(2.0 * norm.cdf(1.96 * deviations[:, 0] / deviations[:, 1]) - 1.0)
    what = (__doc__ or "").strip().split("\n\n", 2)[2]
    page = f"""# How many teams can be inside their own band

Written by `python benchmarks/calibration_bound.py --teams {asked.teams}`.

```text
{what}
```

The deviation of NEES/dof is {alone:.3f} by chi-square and {whole:.3f} with what is not known of odometry's
variances, on average: {inside:.0%} of the teams can be inside.
"""
    print(page, end="")
    if asked.out:
        asked.out.write_text(page)


def spread(log: Dataset) -> tuple[float, float]:
    """The deviation of NEES/dof by chi-square, and with what is not known of odometry's variances."""
    search, fit = searched(linear_at(AtMap(log.tables, full(log).map)))
    free = Components.of(search.slips, search.scales)
    free = free.only(np.append(np.ones(len(free.scaled), bool), search.theta > 0.0))
    at, state = free.logs(search.scales, search.theta), (search.scales, search.theta)
    information = search.pulled(fit.choice, free, *state)[1]

    def spread_at(logs: Array) -> float:
        search.pulled(fit.choice, free, *free.put(logs, *state))
        return -float(search.fit(choice=fit.choice).factor.log_determinant())

    count, here = search.linear.jacobian.shape[1], spread_at(at)
    w = np.array([(spread_at(at + step) - here) / STEP for step in STEP * np.eye(len(free))]) / count
    return float(np.sqrt(2.0 / count)), float(np.sqrt(2.0 / count + w @ np.linalg.solve(information, w)))


if __name__ == "__main__":
    main()
