"""Victoria Park from 200 local maps of another program: python examples/gallery/victoria_park.py VicPark_200_local_maps

The data are not part of teamslam: `teamslam data victoria_park` says where they are.
"""

import sys
import time

import teamslam as ts

maps = ts.read_submaps(sys.argv[1])
began = time.perf_counter()
team = ts.join(maps)
print(f"{len(maps)} local maps joined in {1000 * (time.perf_counter() - began):.0f} ms, no start values given")
print(f"objective of the join {team.components[0].solution.cost:.2f}, {len(team.map.landmark_keys)} trees")
ts.plot(team, title="Victoria Park, joined of 200 local maps").savefig("victoria_park.png")
