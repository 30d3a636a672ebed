"""teamslam's own format, for people's own data: a folder with `team.toml` and CSV files.

    team.toml        who is in the team, and for each file: its sensor, its noise
    odometry.csv     robot,from_stamp,to_stamp,x,y,theta        (or absolute poses, or velocities)
    landmarks.csv    robot,stamp,landmark,range,bearing         (or x,y  or x,y,z  or range  or bearing ...)
    robots.csv       robot,stamp,other,range,bearing            (or x,y,theta ...)

docs/formats.md describes it with an example to copy. `schema` says what may stand in team.toml, `columns` which columns
a sensor's rows have, `keyframes` where robots get poses; `reader` and `writer` put them together.

Law: read(write(dataset)) is the dataset again: keys, measurements and poses to rounding, information W'W, losses,
truth, initial values, names and what was dropped. Not kept: `origin`, and which square root W of the information it
was; a table that mixes landmarks and robots comes back as two.
"""

from teamslam.io.plain.reader import read, sniff
from teamslam.io.plain.writer import lacks, write

__all__ = ["lacks", "read", "sniff", "write"]
