"""Finished maps for other programs."""
