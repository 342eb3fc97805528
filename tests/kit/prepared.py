"""An asset with tools attached, as the stages between reading and encoding see it; and small rigs."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from kit.asset import Array, Asset, Json
from kit.limb import limb_asset, tool
from kit.places import FOLDER
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.prune import Poses
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.surface.rest import Rest, rest_pose
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True)
class Prepared:
    """An asset as the stages before the encoding see it."""

    document: Document
    rig: Rig
    surface: Surface
    clips: tuple[Clip, ...]
    settings: ToolsFile
    rest: Rest
    patches: list[Patch]

    @property
    def patch(self) -> Patch:
        """The only patch, or the first."""
        return self.patches[0]

    @property
    def clip(self) -> Clip:
        """The only clip, or the first."""
        return self.clips[0]

    def refined(self, *, tolerance: float = np.inf, contacts: Array | None = None, influences: int = 4) -> Refinement:
        """The refined surface; no edge is held back by its skin weights."""
        return refine(
            self.surface,
            self.rest,
            self.patches,
            self.rig,
            settings=self.settings.refinement,
            contacts=np.zeros(len(self.surface.positions), bool) if contacts is None else contacts,
            influences=influences,
            poses=Poses(self.rig, (), Memory()),
            tolerance=tolerance,
        )


def as_document(asset: Asset) -> Document:
    """The document that reading the asset gives. It holds all of the file, whose place is used again and again."""
    return read_document(asset.write(FOLDER / "limb.glb"))


def prepare(asset: Asset, *tools: Json, node: int = 0, **header: Any) -> Prepared:
    """Read an asset and attach tools to it, the limb's default tool where none is given."""
    document = as_document(asset)
    settings = parse_tools(json.dumps({"version": 1, **header, "tools": list(tools) or [tool()]}), name="tools.yaml")
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, list(settings.tools))
    patches = attach_tools(list(settings.tools), surface, rest, rig, up=settings.up, clips=clips)
    return Prepared(document, rig, surface, clips, settings, rest, patches)


def posed_surface(prepared: Prepared, clip: Clip | None, times: Floats) -> Floats:
    """(frames, vertices, 3) of the coarse surface, morph targets first."""
    surface, rig = prepared.surface, prepared.rig
    weights = surface.dense_weights(np.arange(len(surface.positions)), len(rig.joints))
    morphed = surface.positions + np.tensordot(morph_weights(rig, clip, times), surface.morph_deltas, axes=1)
    return transform(blend(weights, joint_matrices(rig, clip, times)), morphed)


def unattached(asset: Asset) -> Prepared:
    """An asset at rest, without tools."""
    document = as_document(asset)
    rig, clips = read_rig(document, 0), read_clips(document)
    surface, settings = read_surface(document, rig), ToolsFile(path="tools.yaml")
    return Prepared(document, rig, surface, clips, settings, rest_pose(surface, rig, settings, clips, []), [])


def rig_of(*nodes: dict[str, Any], node: int = 0) -> Rig:
    """The rig of nodes whose meshes have no vertices."""
    gltf = {"asset": {"version": "2.0"}, "nodes": list(nodes), "meshes": [{"primitives": [{"attributes": {}}]}]}
    return read_rig(as_document(Asset(gltf)), node)


def limb(**options: Any) -> tuple[Rig, Clip]:
    """The rig of a small limb, and its first clip."""
    document = as_document(limb_asset(rings=3, sides=4, **options))
    return read_rig(document, 0), read_clips(document)[0]


def rotation_matrix(quaternion: Any) -> Floats:
    """By the double cross product, for a vector v: v + 2 w (q × v) + 2 q × (q × v)."""
    *axis, w = np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion)
    columns = [v + 2 * w * np.cross(axis, v) + 2 * np.cross(axis, np.cross(axis, v)) for v in np.eye(3)]
    return np.stack(columns, axis=1)
