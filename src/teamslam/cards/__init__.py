"""Cards: what a record shows of itself in a notebook. Text in, text out: no figure library, no network, no script."""

from teamslam.cards.card import card
from teamslam.cards.picture import ROBOT_COLOURS, balance, curves, lanes, plan

__all__ = ["ROBOT_COLOURS", "balance", "card", "curves", "lanes", "plan"]
