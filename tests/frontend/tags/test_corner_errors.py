"""Residuals of corners at many poses at once are those that the tables have."""

import numpy as np

from frontend.tags.test_rows import scene, seen_in
from teamslam.frontend.tags.corner_errors import CornerErrors
from teamslam.frontend.tags.rows import LOOKING, Tag, corner_rows
from teamslam.geometry import Pose, concatenate
from teamslam.model import Table, landmark_key, pose_key
from teamslam.sim.film.takes import KINECT


def tables():
    """Two cameras, one of them where the body is, and how what they see stands to them."""
    out, stands = [], []
    for seed, mount in ((0, None), (1, Pose.from_tangent(np.array([0.1, 0.0, 0.3, -1.2, 0.3, -1.1]), 3))):
        poses, pixels = scene(KINECT, np.random.default_rng(seed), 15)
        values, white, good = corner_rows(seen_in(pixels), KINECT, [Tag(k, 0.15, str(k)) for k in range(15)], 0.3, 0.3)
        assert good.all()
        keys = np.stack([np.full(15, pose_key(1, 0)), landmark_key(np.arange(15))], -1)
        out.append(Table(1, "landmarks", "corners", 3, keys, values, white, np.arange(15), mount))
        stands.append(LOOKING.inverse()[None] @ poses)
    return out, concatenate(stands)


def test_residuals_are_those_of_the_tables():
    both, stands = tables()
    ready, rows, rng = CornerErrors.of(both), np.array([2, 3, 17, 29, 3]), np.random.default_rng(5)
    eyes = Pose.from_tangent(rng.normal(size=(4, 1, 6)), 3)
    mounts = concatenate([Pose.identity(3, (15,)), both[1].sensor[None][np.zeros(15, int)]])
    off = Pose.from_tangent(0.2 * rng.normal(size=(1, 5, 6)), 3)
    targets = (eyes[0] @ mounts[rows] @ stands[rows])[None] @ off
    found = ready.at(rows, eyes, targets)
    assert found.shape == (4, 5, 8)
    for c in range(4):
        for k, row in enumerate(rows.tolist()):
            part = both[row // 15].select(np.array([row % 15]))
            h = part.predict_from(eyes[c], targets[0, [k]])
            true = part.whitening @ part.row.minus(part.values, h, 3)[..., None]
            np.testing.assert_allclose(found[c, k], true[0, :, 0], rtol=1e-9, atol=1e-7)


def test_what_is_seen_at_the_opposite_is_half_a_turn_off():
    (table, _), _ = tables()
    row = table.select(np.array([0]))
    ray = row.values[0, :3]
    values = row.values.copy()
    values[0, :12], values[0, 12:] = np.tile(ray, 4), np.tile(-2.0 * ray, 4)
    table = Table(1, "landmarks", "corners", 3, row.keys, values, np.eye(8)[None], row.ids)
    still = Pose.identity(3, (1, 1))
    np.testing.assert_allclose(
        CornerErrors.of([table]).at(np.array([0]), still, still)[0, 0], np.tile([-np.pi, 0.0], 4)
    )
