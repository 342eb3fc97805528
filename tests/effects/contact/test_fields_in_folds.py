"""Contact of a field: the folds that it makes at each joint are solved as those of tools, or lowered."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.asset import Json
from kit.bakes import bake_once, folding_limb
from kit.limb import tool
from kit.player import Gltf
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.contact import crease, lowering
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.review.crossings import crossings

FINE: Json = {"max_levels": 0}


def top(contact: Any = "resolve", **keys: Any) -> Json:
    """A tools file with a field, its contact resolved or not."""
    return {"refinement": FINE, "fields": [{"name": "folds", "contact": contact, **keys}]}


def bake_field(contact: Any = "resolve", **keys: Any) -> Gltf:
    return bake_once(folding_limb(), top=top(contact, **keys))


def written(folder: Path, **keys: Any) -> Path:
    file = folder / "tools.yaml"
    file.write_text(yaml.safe_dump({"version": 1, **top(), **keys}))
    return file


def planned(file: Path) -> MeshPlan:
    (plan,) = plan_meshes(read_job(folding_limb(), file, BakeOptions()))
    return plan


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> MeshPlan:
    """The limb with a field alone."""
    return planned(written(tmp_path_factory.mktemp("field")))


def folds_of(plan: MeshPlan) -> ContactLayer:
    found = plan.layer(ContactLayer)
    assert found is not None
    return found


@cache
def totals(path: Path) -> list[int]:
    """Edges through triangles in all moments of the clip: before the bake, and after it."""
    found: list[int] = crossings(path).data["clips"][0]["totals"]
    return found


def test_a_fold_is_found_at_each_joint_that_folds_a_field(plan: MeshPlan) -> None:
    (fold,) = folds_of(plan).folds
    assert fold.rig.names[fold.hinge.signal.node] == "joint_1"
    assert np.degrees([fold.hinge.least, fold.hinge.most]) == pytest.approx([0.0, 75.0], abs=0.1)
    # The limb is 0.25 thick, and what it bends reaches a little along it.
    assert 0.25 < fold.radius < 0.4


def test_a_fold_is_posed_with_its_field(plan: MeshPlan) -> None:
    (fold,) = folds_of(plan).folds
    (part,) = plan.layers[0].parts
    clip, times = fold.hinge.turn(np.array([0.0, fold.hinge.most])), np.array([0.0, 0.5, 1.0])
    positions, matrices = fold.posed(clip, times)
    moves = np.zeros((3, len(plan.fine.positions), 3))
    moves[:, part.vertices] = part.displacements(plan.fine, plan.rig, clip, times)
    skinned, _ = fold.at_height(0.0).posed(clip, times)
    assert positions == pytest.approx(skinned + np.einsum("fvij,fvj->fvi", matrices, moves[:, fold.vertices]))
    assert np.abs(positions - skinned)[2].max() > 0.3 * part.attached.greatest_height


def test_a_tool_and_a_field_over_one_joint_share_a_fold(tmp_path: Path) -> None:
    hand = tool(name="hand", bumps=2, contact="resolve")
    (fold,) = folds_of(planned(written(tmp_path, tools=[hand]))).folds
    assert [each.tool.name for each in fold.patches] == ["hand", "folds"]


@pytest.mark.slow
def test_a_field_with_contact_crosses_no_more_than_the_skin() -> None:
    file = bake_field()
    before, after = totals(file.path)
    assert after < before < totals(bake_field("off").path)[1]
    (entry,) = file.mesh("limb")["extras"]["targetNames"][-1:]
    assert entry.startswith("wrinkle_folds_joint_1_contact_")


@pytest.mark.slow
def test_contact_that_is_off_changes_nothing() -> None:
    keys = bake_once(folding_limb(), top={"refinement": FINE, "fields": [{"name": "folds"}]})
    assert bake_field("off").path.read_bytes() == keys.path.read_bytes()


@pytest.mark.slow
def test_a_field_whose_fold_is_given_up_is_lowered_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Elsewhere it is as it was."""
    monkeypatch.setattr(crease, "_MOST_STEPS", 4)
    monkeypatch.setattr(crease, "_MOST_STEPS_PER_POSE", 1)
    report = wrinklecli.bake(folding_limb(), written(tmp_path, **top(strength=3)), tmp_path / "out.glb")
    (fold,) = report.data["folds"]
    assert 0.0 < fold["heights"]["folds"] < 1.0
    bodies = [bake_field("off", strength=3), Gltf(tmp_path / "out.glb")]
    full, low = (np.linalg.norm(each.deltas("limb"), axis=2).max(axis=0) for each in bodies)
    assert (low <= full + 1e-7).all()
    assert (low < 0.6 * full).any()
    far = np.abs(bodies[0].attribute("limb", "POSITION")[:, 0]) > 0.6
    assert low[far] == pytest.approx(full[far])


@pytest.mark.slow
def test_a_field_is_level_in_the_end_where_it_crosses(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(lowering, "_TIMES", 1)
    monkeypatch.setattr(lowering, "_LOWER", 1.0)
    file = written(tmp_path, **top(strength=3))
    plan = planned(file)
    (fold,) = folds_of(plan).folds
    job = read_job(folding_limb(), file, BakeOptions())
    (found,) = lowering.lowered(fold, job.clips).values()
    (part,) = plan.layers[0].parts
    assert found.factors.min() == pytest.approx(0.0, abs=1e-9)
    assert found.factors.max() == pytest.approx(1.0)
    assert len(found.factors) == len(part.vertices)
