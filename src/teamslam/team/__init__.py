"""What a robot knows of its team: the submaps it holds, what it may join, what it would send."""

from teamslam.team.admission import Admission, Refusal, admit
from teamslam.team.knowledge import Knowledge
from teamslam.team.ledger import Ledger, Line
from teamslam.team.plan import TOPOLOGIES, Offer, Plan, plan
from teamslam.team.sets import SubmapSet

__all__ = [
    "TOPOLOGIES",
    "Admission",
    "Knowledge",
    "Ledger",
    "Line",
    "Offer",
    "Plan",
    "Refusal",
    "SubmapSet",
    "admit",
    "plan",
]
