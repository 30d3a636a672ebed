"""Finished submaps: teamslam's own file, and the local maps of I-SLSJF and Linear SLAM."""
