"""FACTORS: the types of factors in JRL files and the models they are. Adding a type is adding a row."""

from dataclasses import dataclass

from teamslam.model import MODELS, Kind

KINDS: dict[str, Kind] = {"Pose2": Kind.POSE2, "Pose3": Kind.POSE3, "Point2": Kind.POINT2, "Point3": Kind.POINT3}


@dataclass(frozen=True)
class Factor:
    """One row: a model, its dimension, and the kinds of variables it is about."""

    model: str
    dim: int
    ends: tuple[Kind, ...]

    @property
    def rows(self) -> int:
        """Rows of the covariance."""
        return MODELS[self.model].residual_rows(self.dim)

    @property
    def value_kind(self) -> Kind:
        """The kind of a measured pose or position."""
        return Kind(self.dim - 2) if self.model in ("relative_pose", "pose") else Kind(self.dim)


def _both(name: str, model: str, ends: tuple[str, ...]) -> dict[str, Factor]:
    """The rows of the plane and of space: a '#' stands for the dimension."""
    return {
        name.replace("#", str(d)): Factor(model, d, tuple(KINDS[end.replace("#", str(d))] for end in ends))
        for d in (2, 3)
    }


FACTORS: dict[str, Factor] = {
    **_both("PriorFactorPose#", "pose", ("Pose#",)),
    **_both("PriorFactorPoint#", "position", ("Point#",)),
    **_both("BetweenFactorPose#", "relative_pose", ("Pose#", "Pose#")),
    **_both("RangeFactorPose#", "range", ("Pose#", "Pose#")),
    **_both("RangeFactor#D", "range", ("Pose#", "Point#")),
    **_both("BearingRangeFactorPose#", "range_bearing", ("Pose#", "Pose#")),
    **_both("BearingRangeFactor#D", "range_bearing", ("Pose#", "Point#")),
}
