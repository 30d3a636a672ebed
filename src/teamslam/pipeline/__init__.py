"""The whole story of a run, from a log to a map that is judged and scored.

story       the run, a page of calls
mapping     submaps and their join, rounds, a tree on workers, full least squares
mending     what is put right in a log, before and after there is a map
result      a finished run
clock       how long each stage took
"""

from teamslam.pipeline.clock import Clock, Progress
from teamslam.pipeline.mapping import mapped, pairs, refuse_workers
from teamslam.pipeline.result import Result
from teamslam.pipeline.story import run, scores_of

__all__ = ["Clock", "Progress", "Result", "mapped", "pairs", "refuse_workers", "run", "scores_of"]
