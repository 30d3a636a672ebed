"""When steps should see more of the cost's second derivative than Gauss-Newton does.

    H  =  J'W'WJ   [ - how robust losses bend along their residuals ]   [ - how residuals bend:  d(J'W'We)/dx ]

J'W'WJ alone is sure but may be slow: a robust loss makes its steps too short, large residuals that bend (a range to a
robot passing by) too long or too short, and the distance to the optimum falls by a constant factor at best. Newton's H
converges quadratically, but is indefinite far from the optimum. So the losses' bend comes in within a few sigmas of it,
that of the residuals, which costs as much as seven linearisations, only where a step leaves more than a share `slow`
of the distance; and both go again, until nearer, where H turns out to be indefinite.
"""

from typing import Literal

Curvature = Literal["none", "losses", "all"]

NEAR = 3.0  # [sigmas]
SLOW = 0.5  # the share of the distance left by a step that is slow; below it Gauss-Newton's cheaper steps win
BACK = 0.3  # how much nearer to come before another attempt


class Bend:
    """The `curvature` that the next linearisation should hold, by what is seen of the steps."""

    def __init__(self, slow: float = SLOW) -> None:
        self.curvature: Curvature = "none"
        self._slow = slow
        self._near, self._last = NEAR, float("inf")

    def see(self, distance: float) -> None:
        """Take note of a step: the distance to the optimum that its model promised to go [sigmas]."""
        if distance < self._near:
            slow = distance > self._slow * self._last
            self.curvature = "all" if slow or self.curvature == "all" else "losses"
        self._last = distance

    def retreat(self) -> bool:
        """Give up curvature because H is indefinite; False where there is none to give up."""
        if self.curvature == "none":
            return False
        self.curvature, self._near, self._last = "none", BACK * self._near, float("inf")
        return True
