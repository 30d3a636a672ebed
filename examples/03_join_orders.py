"""Orders of joining: all at once, one after another, by a tree, in rounds; and full least squares beside them.

A joined map is a submap again, so all orders are ways of calling one function. They differ only by where the problem
was linearised. Joining in rounds removes that difference: it ends at the full least squares, although nobody ever
holds all raw measurements.

    python examples/03_join_orders.py
"""

import numpy as np

import teamslam as ts
from teamslam.joining import exact_join, join_by_tree, join_sequentially


def main():
    """How far each order is from full least squares, in sigmas of the variable that differs most."""
    dataset = ts.simulate("2d", seed=3)
    pieces = ts.split(dataset, poses_per_piece=15)
    submaps = [ts.build(piece) for piece in pieces]
    best = ts.full(dataset)

    print(f"{len(submaps)} submaps of {len(dataset.robots)} robots")
    results = {
        "at once": ts.join(submaps),
        "at once, shuffled": ts.join(submaps[::-1]),
        "as they arrive": join_sequentially(submaps),
        "by a tree": join_by_tree(submaps),
        "in rounds (exact)": exact_join(pieces),
    }
    sigmas = np.sqrt(np.concatenate([np.diag(c) for c in ts.Covariances.of_map(best.map).all]))
    for name, result in results.items():
        apart = np.abs(result.map.values.minus(best.map.values)) / sigmas
        print(f"{name:18} at most {apart.max():8.1e} sigma from full least squares")

    exactness = results["in rounds (exact)"].components[0].exactness
    print(f"the exact join took {exactness.rounds} rounds and {exactness.bytes / 1000:.0f} kB of messages")


if __name__ == "__main__":
    main()
