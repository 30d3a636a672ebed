"""When steps should see more of the cost's second derivative than Gauss-Newton does.

    H  =  J'W'WJ   [ - how robust losses bend along their residuals ]   [ - how residuals bend:  d(J'W'We)/dx ]

J'W'WJ alone is sure but may be slow: a robust loss makes its steps too short, large residuals that bend (a range to a
robot passing by) too long or too short, and the distance to the optimum falls by a constant factor at best. Newton's H
converges quadratically, but may be indefinite. So the losses' bend comes in within a few sigmas of the optimum, that of
the residuals, which costs as much as seven linearisations (between submaps next to nothing), only where a step leaves
more than a share `slow` of the distance; and both come in wherever several steps in a row were slow, however far away.
A rule that can do nothing with an indefinite H asks for both to go again, until nearer.
"""

from typing import Literal

Curvature = Literal["none", "losses", "all"]

NEAR = 3.0  # [sigmas]
SLOW = 0.5  # the share of the distance left by a step that is slow; below it Gauss-Newton's cheaper steps win
SLOW_JOIN = 0.1  # the same between submaps, where Newton's steps cost no more
PATIENCE = 3  # slow steps in a row
BACK = 0.3  # how much nearer to come before another attempt


class Bend:
    """The `curvature` that the next linearisation should hold, by what is seen of the steps."""

    def __init__(self, slow: float = SLOW) -> None:
        self.curvature: Curvature = "none"
        self.insists = False
        self._slow = slow
        self._near, self._last, self._in_a_row = NEAR, float("inf"), 0

    def see(self, distance: float, full: bool = True) -> None:
        """Take note of a step: the distance to the optimum that its model promised to go [sigmas], and whether it was a
        full one."""
        slow = distance > self._slow * self._last
        self._in_a_row = self._in_a_row + 1 if slow and full else 0
        if self._in_a_row >= PATIENCE:
            self.insists = True
        if distance < self._near or self.insists:
            self.curvature = "all" if slow or self.curvature == "all" else "losses"
        self._last = distance

    def follow(self, curvature: Curvature) -> None:
        """Hold this curvature from now on, since it showed the way."""
        self.curvature, self.insists, self._last, self._in_a_row = curvature, True, float("inf"), 0

    def retreat(self) -> bool:
        """Give up curvature because H is indefinite; False where there is none to give up."""
        if self.curvature == "none":
            return False
        self.curvature, self.insists, self._in_a_row = "none", False, 0
        self._near, self._last = BACK * self._near, float("inf")
        return True
