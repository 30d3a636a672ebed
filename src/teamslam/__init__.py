"""teamslam: several robots, one map."""
