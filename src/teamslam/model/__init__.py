"""The nouns: what was seen (`Dataset`, `Table`), what is believed (`Values`, `Submap`), and what they are called."""

from teamslam.model.account import LeftOut
from teamslam.model.asked import (
    A_LOG,
    A_PATH,
    Asked,
    a_kind,
    expect,
    is_whole,
    key_asked,
    landmark_asked,
    nearest,
    pose_asked,
    robot_asked,
    robot_names,
)
from teamslam.model.chi_square import chi2_quantile, region_of
from teamslam.model.dataset import Dataset, Dropped
from teamslam.model.keys import (
    WORLD,
    Names,
    index_of,
    is_landmark,
    is_parameter,
    is_pose,
    is_unnamed,
    landmark_key,
    landmark_number,
    parameter_keys,
    pose_key,
    robot_of,
    unnamed_key,
    whole,
)
from teamslam.model.layout import Kind, Layout, among, distinct, point_kind, pose_kind, rows_of
from teamslam.model.losses import LOSSES, SQUARED, Loss, LossFunction
from teamslam.model.noise import ranks, variances, whitening, whitening_of_information
from teamslam.model.rebased import rebased
from teamslam.model.sensors import MODELS, Model
from teamslam.model.sources import Sources, Stretch
from teamslam.model.submap import Submap
from teamslam.model.tables import Table, told_by
from teamslam.model.unknowns import Stamps, Standing, Unknown, Unknowns
from teamslam.model.values import Values, pack, unpack

__all__ = [
    "A_LOG",
    "A_PATH",
    "LOSSES",
    "MODELS",
    "SQUARED",
    "WORLD",
    "Asked",
    "Dataset",
    "Dropped",
    "Kind",
    "Layout",
    "LeftOut",
    "Loss",
    "LossFunction",
    "Model",
    "Names",
    "Sources",
    "Stamps",
    "Standing",
    "Stretch",
    "Submap",
    "Table",
    "Unknown",
    "Unknowns",
    "Values",
    "a_kind",
    "among",
    "chi2_quantile",
    "distinct",
    "expect",
    "index_of",
    "is_landmark",
    "is_parameter",
    "is_pose",
    "is_unnamed",
    "is_whole",
    "key_asked",
    "landmark_asked",
    "landmark_key",
    "landmark_number",
    "nearest",
    "pack",
    "parameter_keys",
    "point_kind",
    "pose_asked",
    "pose_key",
    "pose_kind",
    "ranks",
    "rebased",
    "region_of",
    "robot_asked",
    "robot_names",
    "robot_of",
    "rows_of",
    "told_by",
    "unnamed_key",
    "unpack",
    "variances",
    "whitening",
    "whitening_of_information",
    "whole",
]
