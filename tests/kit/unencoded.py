"""The package's own result for a clip before it is encoded, vertex by vertex: no pruning, targets or tracks."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from kit.player import Floats, Gltf
from wrinklecli.baking.refined_mesh import primitives_of, shared_vertices
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.effects.wrinkle.carry import displacements
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.gltf.document import read_document
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import Length


@dataclass(frozen=True)
class Case:
    """An asset with tools on its one deforming mesh."""

    asset: Path
    tools: Path
    node: int

    @property
    def clips(self) -> list[int]:
        """The numbers of the asset's clips."""
        return list(range(len(Gltf(self.asset).json["animations"])))


@cache
def planned(found: Case) -> MeshPlan:
    """The plan of a case's mesh, made once."""
    document, settings = read_document(found.asset), load_tools(found.tools)
    (clips, one) = (read_clips(document), Length(1.0, percent=True))
    return plan_mesh(document, found.node, list(settings.tools), settings, clips, one)


def unencoded(plan: MeshPlan, asset: Path, clip: int, times: Floats) -> Floats:
    """(times, glTF vertices, 3) of a clip."""
    rig, fine = plan.rig, plan.fine
    document = read_document(asset)
    (found,) = (each for each in read_clips(document) if each.index == clip)
    bind = fine.positions + np.tensordot(morph_weights(rig, found, times), fine.morph_deltas, axes=1)
    for carried in carried_patches_of(plan):
        bind[:, carried.vertices] += displacements(carried, fine, rig, found, times)
    weights = fine.dense_weights(np.arange(len(fine.positions)), len(rig.joints))
    moved = transform(blend(weights, joint_matrices(rig, found, times)), bind)
    # Primitives that share their vertices share the new ones too.
    parts = primitives_of(fine, shared_vertices(document, rig.mesh, fine))
    return moved[:, np.concatenate([part.weld for part in parts])]
