"""How a robot maps while it drives, as options of the commands that let robots drive."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import whole

if TYPE_CHECKING:
    from teamslam.robot import Options


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Steps:
    """What is given of `teamslam.robot.Options`."""

    poses_per_piece: Annotated[
        int | None, Parameter(converter=whole, help="A submap closes after so many poses [default: 100].")
    ] = None
    heading_sigma: Annotated[
        float | None,
        Parameter(help="A submap closes where its dead-reckoned heading is uncertain by this angle [rad]."),
    ] = None
    horizon: Annotated[
        float | None,
        Parameter(
            help="How far behind the newest row another may come [s]; a row that comes later is left out, and counted "
            "[default: 0]."
        ),
    ] = None
    landmarks: Annotated[
        int | None,
        Parameter(
            converter=whole,
            help="How many landmarks are carried from moment to moment at most: what a moment costs [default: 64].",
        ),
    ] = None

    def over(self, options: "Options") -> "Options":
        """Options with what is given in place of theirs."""
        from teamslam.duty import told

        found: Options = told(
            options,
            {
                "poses_per_piece": self.poses_per_piece,
                "heading_sigma": self.heading_sigma,
                "horizon_s": self.horizon,
                "landmarks": self.landmarks,
            },
        )
        return found


NONE = Steps()
