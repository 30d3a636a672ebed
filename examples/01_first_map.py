"""A first map: a simulated team, one map, its errors and a figure.

Three robots drive on the ground among landmarks at different heights. Each logs odometry, where it sees landmarks, and
now and then where it sees another robot. Nobody knows where the others started.

    python examples/01_first_map.py
"""

import teamslam as ts


def main():
    """Log in, map out."""
    dataset = ts.simulate("planar", seed=1)

    submaps = [ts.build(piece) for piece in ts.split(dataset)]  # each robot's own map of its own log: Algorithm 1
    team = ts.join(submaps)  # one map of all: Algorithm 2

    print(f"{len(submaps)} submaps, {len(team.map.values)} variables in one map")
    print(team.components[0].solution.status.value)
    print(ts.score(team.map, dataset.truth))

    figure(team.map, dataset).savefig("first_map.png", dpi=150)
    print("first_map.png shows it")


def figure(submap, dataset):
    """The map with 95 % regions of the landmarks, and the truth."""
    from teamslam.results.errors import truth_by_team
    from teamslam.viz import Scene, draw_map

    marks = submap.landmark_keys
    regions = dict(zip(marks.tolist(), ts.Covariances.of_map(submap).blocks(marks), strict=True))
    return draw_map(Scene(submap, regions, truth_by_team(submap, dataset.truth), title="A first map"))


if __name__ == "__main__":
    main()
