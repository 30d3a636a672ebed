"""Before a mission: what a team will know, if it drives as planned among the landmarks that are planned."""

from teamslam.trust.foresee.foresee import Foreseen, foresee
from teamslam.trust.foresee.mission import Mission, read_mission
from teamslam.trust.foresee.tags import Tag, place_next

__all__ = ["Foreseen", "Mission", "Tag", "foresee", "place_next", "read_mission"]
