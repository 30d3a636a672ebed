"""Recordings: ROS 1 bags, ROS 2 recordings (sqlite3, MCAP), read without ROS; by the package `rosbags`.

parts       which files are one recording
opened      a recording open: its topics, and its messages one after another
roles       what the types of messages are for, and the definitions of those that are not part of ROS
contents    what a recording holds, with rates and gaps
streams     messages of one topic as arrays
tree        the frames that were broadcast (tf)
proposal    a first team file for a recording
"""

from teamslam.io.bags.contents import Contents, TopicContents, contents
from teamslam.io.bags.opened import Recording, is_recording, opened
from teamslam.io.bags.parts import parts_beside, recordings_of
from teamslam.io.bags.proposal import proposal
from teamslam.io.bags.streams import read_corners, read_track, read_transforms

__all__ = [
    "Contents",
    "Recording",
    "TopicContents",
    "contents",
    "is_recording",
    "opened",
    "parts_beside",
    "proposal",
    "read_corners",
    "read_track",
    "read_transforms",
    "recordings_of",
]
