"""Landmarks without names: which sightings are of the same one, within a robot's way and across the team."""

from teamslam.trust.associate.associate import Associated, Rivals, associate

__all__ = ["Associated", "Rivals", "associate"]
