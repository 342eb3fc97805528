"""Tools of the limb carried by its refined surface, and what they displace."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kit.limb import limb_asset, tool
from kit.prepared import Prepared, as_document
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import read_rig
from wrinklecli.effects.wrinkle.carry import CarriedPatch, carry, displacements
from wrinklecli.surface.refine import Refinement

Floats = NDArray[np.float64]


ROOTS = [
    {},
    {"rotation": [0.1, 0.5, -0.3, 0.8], "translation": [3, -2, 1]},
    {"scale": [3, 3, 3]},
    {"scale": [-1, 1, 1]},
    {"scale": [0.5, 2, 1]},
    {"scale": [-1, -2, -0.5], "rotation": [0, 0.6, 0, 0.8]},
]
# Imposes shortening at rest: a fifth more skin than there is room for.
MORE = {"keys": {"fold": [[0, "120%"], [1, "120%"]]}}


def placed(root: Any, **keys: Any) -> dict[str, Any]:
    """The limb's default tool where a root transform has put its place."""
    document = as_document(limb_asset(rings=3, sides=4, root=root))
    matrix = node_matrices(read_rig(document, 0), None, np.zeros(1), [3])[0, 0]
    ends = {key: (matrix[:3, :3] @ tool()[key] + matrix[:3, 3]).tolist() for key in ("origin", "target")}
    return tool(**ends, **{"width": "40%", **keys})


def carry_patch(prepared: Prepared, *, pinned: Any = None) -> tuple[CarriedPatch, Refinement]:
    fine = prepared.refined()
    pins = np.zeros(len(prepared.surface.positions), bool) if pinned is None else pinned
    return carry(prepared.patch, fine, pins), fine


def moved(prepared: Prepared, carried: CarriedPatch, fine: Refinement, times: Any) -> Floats:
    return displacements(carried, fine, prepared.rig, prepared.clip, np.asarray(times, float))


def scattered(carried: CarriedPatch, fine: Refinement, displacement: Floats) -> Floats:
    """(frames, fine vertices, 3), 0 where the tool moves no vertex."""
    every = np.zeros((len(displacement), len(fine.positions), 3))
    every[:, carried.vertices] = displacement
    return every
