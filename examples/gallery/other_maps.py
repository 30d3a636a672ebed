"""Maps by another program, joined: python examples/gallery/other_maps.py

Any program that gives an estimate and its information can hand its local maps over as text: the frame's id, n, n lines
`id value` (ids below 0: the pose at the end, x, y, heading; above 0: a landmark, x, y), and the n x n information. Here
NumPy makes three of a way among five landmarks; each begins where the one before ended.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

import teamslam as ts

LANDMARKS = np.array([[2.0, 2.0], [5.0, -1.0], [8.0, 2.5], [11.0, 0.0], [4.0, 4.5]])
WAY = np.array([[0.0, 0.0, 0.0], [4.0, 0.5, 0.3], [8.0, 1.0, -0.2], [12.0, 1.5, 0.0]])
rng = np.random.default_rng(8)

folder = Path("maps")
folder.mkdir()
for number, (begin, end) in enumerate(pairwise(WAY), 1):
    frame, seen = ts.Pose.from_xytheta(begin), [n for n in range(5) if np.hypot(*(LANDMARKS[n] - begin[:2])) < 7]
    there = frame.between(ts.Pose.from_xytheta(end)).xytheta()
    truth = np.concatenate([there, *(frame.unact(LANDMARKS[n]) for n in seen)])
    root = rng.normal(size=(len(truth), len(truth))) * 0.02 + np.eye(len(truth)) * 0.05
    state = truth + root @ rng.normal(size=len(truth))  # what its filter believes, with this information
    ids = [-number] * 3 + [n + 1 for n in seen for _ in range(2)]
    lines = [str(1 - number), str(len(ids)), *(f"{i} {v:.9f}" for i, v in zip(ids, state, strict=True))]
    lines += [" ".join(f"{v:.9g}" for v in row) for row in np.linalg.inv(root @ root.T)]
    (folder / f"localmap_{number}.txt").write_text("\n".join(lines) + "\n")

team = ts.join(ts.read_submaps(folder))
print(team.components[0].solution.status.value)
for landmark in team.landmarks:
    print(landmark, "; true:", LANDMARKS[int(landmark.name) - 1])
ts.plot(team, title="Three local maps of another program, joined").savefig("other_maps.png")
