"""Robots that exchange submaps: what a message holds and weighs, what a robot knows of its team."""

from teamslam.net.admission import Admission, Refusal, admit
from teamslam.net.bound import shift_bound
from teamslam.net.cluster import Cluster, Processes, Workers
from teamslam.net.ledger import Ledger, Line
from teamslam.net.messages import KINDS, Message, Received, receive, send, send_raw
from teamslam.net.plan import TOPOLOGIES, Offer, Plan, plan
from teamslam.net.rounding import COMPACT, EXACT, Precision
from teamslam.net.sets import SubmapSet
from teamslam.net.tree import join_in_tree
from teamslam.net.treemap import TreeMap, gather

__all__ = [
    "COMPACT",
    "EXACT",
    "KINDS",
    "TOPOLOGIES",
    "Admission",
    "Cluster",
    "Ledger",
    "Line",
    "Message",
    "Offer",
    "Plan",
    "Precision",
    "Processes",
    "Received",
    "Refusal",
    "SubmapSet",
    "TreeMap",
    "Workers",
    "admit",
    "gather",
    "join_in_tree",
    "plan",
    "receive",
    "send",
    "send_raw",
    "shift_bound",
]
