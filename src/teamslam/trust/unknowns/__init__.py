"""What a log rests on and nobody measured, estimated with the map: see docs/recordings.md."""

from teamslam.trust.unknowns.known import with_unknowns
from teamslam.trust.unknowns.settle import Found, Settled, settled
from teamslam.trust.unknowns.windows import Window
from teamslam.trust.unknowns.words import sentences_of

__all__ = ["Found", "Settled", "Window", "sentences_of", "settled", "with_unknowns"]
