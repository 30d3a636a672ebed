"""What a team will know, against the dense bound and against teams that drive the plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hung import two_halves
from teamslam.errors import InputError
from teamslam.metrics.bound import cramer_rao
from teamslam.model import Dataset, is_pose
from teamslam.sim import PRESETS, simulate
from teamslam.trust.foresee import foresee, place_next, read_mission
from teamslam.trust.foresee.tags import added
from teamslam.trust.weak import knowledge_from

MISSION = """
speed_m_s = 0.5
[[robot]]
name = "red"
way = [[0, 0], [8, 0], [8, 5]]
landmarks = { model = "range_bearing", range_m = 4.0 }
robots = false
[[robot]]
name = "blue"
way = [[20, 0], [12, 1], [9, 6]]
landmarks = { model = "range_bearing", range_m = 4.0 }
robots = false
[[landmark]]
name = "door"
at = [10.0, 4]
[[landmark]]
name = "lift"
at = [2.0, 2.0]
[[landmark]]
name = "far"
at = [60.0, 2.0]
"""


@pytest.mark.parametrize("preset", ["2d", "planar", "3d", "mixed", "tags", "paper", "paper_minimum"])
def test_figures_are_the_cramer_rao_bound(preset: str) -> None:
    """By a linearisation of its own, dense."""
    log = simulate(preset, seed=3)
    found, bound = foresee(log), cramer_rao(log)
    assert found.base == bound.base
    assert found.tied.all()
    for key, start, dof in zip(bound.layout.keys.tolist(), bound.layout.dof_start, bound.layout.dofs, strict=False):
        block = bound.covariance[start : start + dof, start : start + dof]
        np.testing.assert_allclose(found.covariances[key], block, rtol=1e-6, atol=1e-7 * np.abs(block).max())
    np.testing.assert_allclose(found.covariances[bound.base], 0.0, atol=1e-9)


@pytest.mark.parametrize("world", ["2d", "planar", "3d"])
def test_what_hangs_loose_has_no_covariance_and_what_is_tied_has_its_own(world: str) -> None:
    """Robot 1's part is known as if robot 2 were not there; robot 2's is not known."""
    log = two_halves(world, 0)
    found = foresee(log)
    alone = log.of_robot(1)
    bound = cramer_rao(Dataset({1: log.robots[1]}, alone.tables, log.names, log.truth.only(alone.layout.keys)))
    keys = found.values.layout.keys
    assert set(keys[found.tied].tolist()) == {*bound.layout.keys.tolist(), bound.base}
    assert np.isnan(found.place_m[~found.tied]).all()
    for key, start, dof in zip(bound.layout.keys.tolist(), bound.layout.dof_start, bound.layout.dofs, strict=False):
        block = bound.covariance[start : start + dof, start : start + dof]
        np.testing.assert_allclose(found.covariances[key], block, rtol=1e-6, atol=1e-7 * np.abs(block).max())
    assert any("not tied to robot 1" in said for said in found.sentences)


def mission(tmp_path: Path, text: str = MISSION) -> Path:
    """A mission file."""
    path = tmp_path / "mission.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_mission_says_what_is_missing(tmp_path: Path) -> None:
    """One landmark in common is a hinge; what nobody sees is named; one more landmark cures it, and then it does."""
    plan = read_mission(mission(tmp_path))
    log = plan.dataset()
    found = foresee(log, plan.named_landmarks)
    assert found.unseen == ("far",)
    assert len(found.weak.open) == 1
    assert "about landmark door against" in found.weak.open_sentences[0]
    assert "Nobody will see landmark far" in found.sentences
    red, blue = found.way(1), found.way(2)
    assert found.tied[red].all()
    assert not found.tied[blue].any()
    np.testing.assert_allclose(plan.ways[1].translation[[0, -1]], [[0, 0], [8, 5]])
    steps = np.linalg.norm(np.diff(plan.ways[1].translation, axis=0), axis=1)
    assert steps.max() <= 0.5 + 1e-9
    tag = place_next(found, log)[0]
    assert tag.ties == 1
    assert not foresee(added(log, found, tag)).weak.open


@pytest.mark.parametrize(
    ("preset", "smaller"),
    [(space, {"poses": 12, "landmarks": 10}) for space in ("2d", "planar", "3d")] + [("paper_minimum", {})],
)
def test_a_tag_brings_what_is_promised(preset: str, smaller: dict[str, int]) -> None:
    """Exactly: the weak directions by the same functions, the gain by determinants of the rest."""
    log = simulate(replace(PRESETS[preset], **smaller), seed=1)
    found = foresee(log)
    for tag in place_next(found, log, most=2):
        more = added(log, found, tag)
        after = knowledge_from(more.tables, more.truth, log.names)
        rest = found.values.layout.keys
        mine, theirs = found.values.layout.unknowns(rest), after.values.layout.unknowns(rest)
        for direction, sigma in zip(found.weak.directions, tag.after, strict=True):
            f = np.zeros(after.values.layout.dof)
            f[theirs] = direction.hinge.function[mine]
            assert np.sqrt(f @ after.spread(f)) == pytest.approx(sigma, rel=1e-5)
        assert tag.gain == pytest.approx(0.5 * (shape(found.known) - shape(after, theirs)), rel=1e-4)
        assert tag.sightings == sum(map(len, more.tables)) - sum(map(len, log.tables))


def shape(known, unknowns: np.ndarray | None = None) -> float:
    """log det of the covariance in the frame of the first pose, of some unknowns."""
    base = int(np.sort(known.values.layout.keys[is_pose(known.values.layout.keys)])[0])
    layout = known.values.layout
    G = known.motions.of_the_whole
    own = layout.unknowns(np.array([base]))
    rest = np.setdiff1d(np.arange(layout.dof) if unknowns is None else unknowns, own)
    P = known.spread(np.eye(layout.dof))
    T = np.eye(layout.dof)
    T[:, own] -= G @ np.linalg.pinv(G[own])
    return float(np.linalg.slogdet((T @ P @ T.T)[np.ix_(rest, rest)])[1])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("speed_m_s", "sped"), "unknown key 'sped'; did you mean 'speed_m_s'?"),
        (("= 0.5", "= -1"), "a number above zero is needed, found -1"),
        (('name = "blue"', 'name = "red"'), "the name 'red' stands twice"),
        (("range_m = 4.0", "rang_m = 4.0"), "unknown key 'rang_m'; did you mean 'range_m'?"),
        (("range_m = 4.0", 'range_m = "far"'), "range_m"),
        (("range_m = 4.0", "range_m = -4.0"), "a number above zero is needed"),
        (("[[0, 0], [8, 0], [8, 5]]", "[[0, 0]]"), "expected corners"),
        (("[[0, 0], [8, 0], [8, 5]]", "[[0, 0], [0, 0]]"), "the same place"),
        (("at = [10.0, 4]", ""), "expected a place"),
        (("[[robot]]", "[[robots]]"), "unknown key 'robots'; did you mean 'robot'?"),
        (("speed_m_s =", "speed_m_s"), "not valid TOML"),
    ],
)
def test_mistakes_in_a_mission_are_named(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    path = mission(tmp_path, MISSION.replace(*change))
    with pytest.raises(InputError) as caught:
        read_mission(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_log_without_places_cannot_be_planned_with() -> None:
    with pytest.raises(InputError, match="needs the places"):
        foresee(replace(simulate("2d"), truth=None))
