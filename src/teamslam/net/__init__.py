"""Robots that exchange submaps: what a message holds and weighs, what a robot knows of its team."""

from teamslam.net.admission import Admission, Refusal, admit
from teamslam.net.bound import shift_bound
from teamslam.net.ledger import Ledger, Line
from teamslam.net.messages import KINDS, Message, Received, receive, send, send_raw
from teamslam.net.plan import TOPOLOGIES, Offer, Plan, plan
from teamslam.net.rounding import COMPACT, EXACT, Precision
from teamslam.net.sets import SubmapSet

__all__ = [
    "COMPACT",
    "EXACT",
    "KINDS",
    "TOPOLOGIES",
    "Admission",
    "Ledger",
    "Line",
    "Message",
    "Offer",
    "Plan",
    "Precision",
    "Received",
    "Refusal",
    "SubmapSet",
    "admit",
    "plan",
    "receive",
    "send",
    "send_raw",
    "shift_bound",
]
