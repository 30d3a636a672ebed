"""Submaps and measurements as bytes: what a message holds, what rounding costs. It knows no team."""

from teamslam.wire.bound import shift_bound
from teamslam.wire.messages import KINDS, Message, Received, receive, send, send_raw
from teamslam.wire.rounding import COMPACT, EXACT, Precision

__all__ = [
    "COMPACT",
    "EXACT",
    "KINDS",
    "Message",
    "Precision",
    "Received",
    "receive",
    "send",
    "send_raw",
    "shift_bound",
]
