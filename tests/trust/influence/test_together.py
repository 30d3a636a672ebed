"""Maps that share enough to be one, and do not fit, are one for those who ask who lies; each other keeps its reason."""

import faults
from teamslam.joining import build, join, split
from teamslam.sim import simulate
from teamslam.trust.influence.together import together


def test_what_is_laid_together_has_no_reason_to_stand_apart() -> None:
    log = faults.plant(simulate("2d", 3), faults.longer(2.0), source="landmarks", robots=(2,))
    log = log.with_tables([table for table in log.tables if table.source != "robots"])
    submaps = [build(piece) for piece in split(log)]
    apart = join(submaps)
    assert len(apart.components) > 1 and len(apart.reasons) == len(apart.components) - 1
    one = together(submaps, apart)
    assert len(one.components) < len(apart.components)
    assert len(one.reasons) == len(one.components) - 1
    assert len(join(submaps, near=one).components) == len(one.components)
