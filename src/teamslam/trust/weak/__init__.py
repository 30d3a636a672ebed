"""What a map does not know, what it knows least, and what to look at next."""

from teamslam.trust.weak.knowledge import Knowledge, knowledge_at, knowledge_from, knowledge_of
from teamslam.trust.weak.weakest import Direction, Weak, weakest, weakest_of

__all__ = ["Direction", "Knowledge", "Weak", "knowledge_at", "knowledge_from", "knowledge_of", "weakest", "weakest_of"]
