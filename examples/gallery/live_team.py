"""A team that maps while it drives, over links that lose packets: python examples/gallery/live_team.py

Each robot closes a submap every 20 poses and exchanges them; a third of all packets is lost. In the end all hold the
same map, to the bit.
"""

import numpy as np
from matplotlib.figure import Figure

import teamslam as ts
from teamslam.fleet import fleet
from teamslam.model import index_of
from teamslam.robot import Options
from teamslam.robot.link.memory import Weather
from teamslam.viz import robot_colour

log = ts.simulate("2d", robots=3, poses=100, seed=7)
team = fleet(log, Options(poses_per_piece=20), weather=Weather(loss=0.3), seed=1)

print(f"all hold the same {team.settled_s:.1f} s after the last row; {sum(team.carried.values()):,} bytes were carried")
maps = [ts.join(member.peer.held.submaps).map for member in team.members.values()]
print("equal to the bit:", all((found.values.state == maps[0].values.state).all() for found in maps))

figure = Figure(figsize=(7.4, 3.6), layout="constrained")
axes = figure.subplots()
for number, member in team.members.items():
    stamps = [index_of(now.key) / 1e6 for now in member.told]
    sigmas = [np.sqrt(np.trace(now.covariance[:2, :2])) for now in member.told]
    axes.plot(stamps, sigmas, color=robot_colour(number - 1), label=f"robot {number}")
axes.set(
    xlabel="time [s]",
    ylabel="sigma of the position now [m]",
    title="What each robot knew of its place, in its map's frame",
)
axes.legend()
figure.savefig("live_team.png", dpi=160)
