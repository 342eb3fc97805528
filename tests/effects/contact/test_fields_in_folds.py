"""A fold of tools is posed with the fields of its mesh."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.asset import Json
from kit.bakes import bake_once, folding_limb
from kit.limb import tool
from kit.player import Gltf
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.field.layer import FieldLayer
from wrinklecli.review.crossings import crossings

TOP: Json = {"refinement": {"max_levels": 0}, "fields": [{"name": "folds"}]}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> MeshPlan:
    """The limb with a tool that asks for contact, and a field beneath it."""
    file = tmp_path_factory.mktemp("field") / "tools.yaml"
    file.write_text(yaml.safe_dump({"version": 1, **TOP, "tools": [tool(name="hand", bumps=2, contact="resolve")]}))
    (found,) = plan_meshes(read_job(folding_limb(), file, BakeOptions()))
    return found


@pytest.mark.slow
def test_a_fold_is_posed_with_the_field_beneath(plan: MeshPlan) -> None:
    contact, fields = plan.layer(ContactLayer), plan.layer(FieldLayer)
    assert contact is not None
    assert fields is not None
    (fold,), (part,) = contact.folds, fields.parts
    assert [each.tool.name for each in fold.patches] == ["hand"]
    clip, times = fold.hinge.sweeps[0]
    positions, matrices = map(np.array, zip(*fold.at_height(0.0).poses(clip, times), strict=True))
    moves = np.zeros((len(times), len(plan.fine.positions), 3))
    moves[:, part.vertices] = part.displacements(plan.fine, plan.rig, clip, times)
    skinned = np.array([places for places, _ in replace(fold, carried=(), movers=()).poses(clip, times)])
    assert positions == pytest.approx(skinned + np.einsum("fvij,fvj->fvi", matrices, moves[:, fold.vertices]))
    assert np.abs(positions - skinned)[-1].max() > 0.2 * part.attached.greatest_height


@pytest.mark.slow
@pytest.mark.long
def test_a_tool_keeps_what_a_field_folds_apart() -> None:
    def total(contact: str) -> int:
        file: Gltf = bake_once(folding_limb(), tool(name="hand", bumps=2, contact=contact), top=TOP)
        found: int = crossings(file.path).data["clips"][0]["totals"][1]
        return found

    assert total("resolve") <= 0.1 * total("off")
