"""Trusses of bodies as tests make them: by themselves, with all rows between them."""

from collections.abc import Iterable, Sequence

from teamslam.geometry import Pose
from teamslam.joining.place.frameworks import Truss, in_their_dimension
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.ties import Tied
from teamslam.model import Table


def truss_of(outlines: Sequence[Outline], flat: Sequence[bool], raw: Iterable[Table] = ()) -> Truss:
    """`outlines` of bodies, which of them stay in the plane, and raw measurements."""
    return Truss(Tied.of(outlines, flat, raw).among(range(len(outlines))))


def assemblies(outlines: Sequence[Outline], flat: Sequence[bool], raw: Iterable[Table] = ()) -> list[list[Pose]]:
    """The bodies' frames in every assembly that fits and is rigid, best fit first; the first frame is the identity."""
    truss = truss_of(outlines, flat, raw)
    if not truss.may_be_rigid():
        return []
    return [in_their_dimension(a.frames, flat) for a in truss.assemblies() if a.fits and not a.nullity]


def freedom(shared: Outline, planar: bool) -> int:
    """In how many directions a body that is pinned at these places can still move."""
    return truss_of([shared, shared], [planar] * 2)._nullity(Pose.identity(3, (2,)))
