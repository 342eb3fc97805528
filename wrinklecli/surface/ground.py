"""A node's mesh at rest, before effects are on it: what many plans for one mesh share."""

import json
from collections.abc import Hashable, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Contacts, Neighbours, contacts_of
from wrinklecli.character.rig import DrivenTargets, Rig, read_rig
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.closest import Tree
from wrinklecli.numeric.rays import ray_hits
from wrinklecli.surface.prune import Poses
from wrinklecli.surface.rest import Rest, rest_pose
from wrinklecli.tools.records import EffectTool, ToolsFile

if TYPE_CHECKING:
    from wrinklecli.surface.swatch import Pictures

# Vertices that another mesh has at least over this one, or this one below it, if it is part of what one wears.
_FEW = 4


@dataclass(frozen=True, eq=False)
class Ground:
    """A node's mesh at rest, before tools are on it: what many plans for one mesh share.

    Attributes:
        document: The asset.
        rig: Of the node.
        surface: The mesh, welded.
        rest: Its rest pose.
        clips: Of the asset, whichever are baked.
        neighbours: The meshes of the asset.
        known: Values that many tools share, by what they were read from: images of masks, substances, poses of fields.
    """

    document: Document
    rig: Rig
    surface: Surface
    rest: Rest
    clips: tuple[Clip, ...]
    neighbours: Neighbours
    known: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def contacts(self) -> Contacts:
        """The vertices that must stay where they are, and copies of the mesh."""
        return contacts_of(self.neighbours, self.rig, self.surface, self.rest.positions)

    @cached_property
    def looks(self) -> Ints:
        """(primitives,) equal numbers for those whose materials look the same; names of materials do not count."""
        known: dict[str, int] = {}
        found = []
        for primitive in self.document.items("meshes")[self.rig.mesh]["primitives"]:
            number, materials = primitive.get("material"), self.document.items("materials")
            material = materials[number] if isinstance(number, int) and 0 <= number < len(materials) else {}
            look = json.dumps(_look(self.document, material), sort_keys=True)
            found.append(known.setdefault(look, len(known)))
        return np.array(found, np.intp)

    @cached_property
    def pictures(self) -> "Pictures":
        """The textures of the asset, as far as places were looked at."""
        from wrinklecli.surface.swatch import Pictures  # most bakes look at none

        return Pictures(self.document)

    @cached_property
    def poses(self) -> Poses:
        """A few of every clip."""
        return Poses(self.rig, self.clips, self.document.memory)

    def meshes_over(self, reaches: Floats) -> tuple[str, ...]:
        """Name the other meshes that lie over this one as clothes do.

        Args:
            reaches: (vertices,) distances over the skin, scene units, within which another mesh counts; 0 where none
                does. Between vertices, the distance is interpolated.

        Raises:
            AssetError: Another mesh is malformed.
        """
        places, triangles = self.rest.positions, self.rest.triangles
        below = triangles[(reaches[triangles] > 0).any(axis=1)]
        if not len(below):
            return ()
        reach, skin = float(reaches.max()), places[distinct_values(below)]
        box = skin.min(axis=0) - reach, skin.max(axis=0) + reach
        rising = np.flatnonzero(reaches)
        rays = self.rest.normals_at(rising) * reaches[rising, None]
        found = []
        others = self.neighbours.near(self.rig.node, *box), self.neighbours.triangles_near(self.rig.node, *box)
        for (node, points), (_, corners) in zip(*others, strict=True):
            # Clothes may have few vertices, and so may the skin: those of both count.
            if node in self.contacts.copies:
                continue
            over = self._within(points, below, reaches, box)
            if over >= _FEW or _meeting(places[rising], rays, corners, box) >= _FEW:
                found.append(self.rig.names[node])
        return tuple(found)

    def _within(self, points: Floats, below: Ints, reaches: Floats, box: tuple[Floats, Floats]) -> int:
        """Count the (points, 3) over (below, 3) triangles of this mesh, within the reaches of their vertices."""
        places, (low, high) = self.rest.positions, box
        points = points[((points >= low) & (points <= high)).all(axis=1)]
        feet, shares, nearest = Tree.of(places, below).closest_points(points)
        corners = below[feet]
        one, two, three = np.moveaxis(places[corners], 1, 0)
        away = points - nearest
        outside = np.einsum("vx,vx->v", away, np.cross(two - one, three - one)) > 0
        within = (away**2).sum(axis=1) < (shares * reaches[corners]).sum(axis=1) ** 2
        return int((outside & within).sum())

    def moved_by(self, drives: Sequence[DrivenTargets], deltas: Floats) -> "Ground":
        """The mesh as effects move it too, by (their targets, vertices, 3) deltas, bind space; the same at rest."""
        rig, surface = self.rig.driven_by(drives), self.surface
        return replace(
            self,
            rig=rig,
            surface=replace(surface, morph_deltas=np.concatenate([surface.morph_deltas, deltas])),
            rest=replace(self.rest, morph_weights=np.append(self.rest.morph_weights, np.zeros(len(deltas)))),
        )


def read_ground(
    document: Document,
    node: int,
    tools: Sequence[EffectTool],
    settings: ToolsFile,
    clips: tuple[Clip, ...],
    *,
    neighbours: Neighbours | None = None,
) -> Ground:
    """Read the mesh of a node, at rest as the tools file says: `rest: bind` asks where its first tool is.

    Raises:
        WrinkleError: The mesh is at fault, or the clip that `rest` names is not there.
    """
    neighbours = neighbours or Neighbours(document)
    document, rig = _turnable(document, read_rig(document, node, neighbours.hierarchy), clips)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, tools)
    return Ground(document, rig, surface, rest, clips, neighbours)


def _turnable(document: Document, rig: Rig, clips: Sequence[Clip]) -> tuple[Document, Rig]:
    """A document and its rig in which effects can turn joints whose matrices are stored whole.

    Clips cannot move these (glTF 2.0 §3.5.3), so a joint that one addresses stays as it is, and as players show it.
    """
    addressed = {channel.node for clip in clips for channel in clip.channels}
    stored = {joint for joint in rig.joints.tolist() if "matrix" in rig.locals[joint]} - addressed
    if not stored:
        return document, rig
    from wrinklecli.character.joined import with_free_nodes  # few files have such joints

    document = with_free_nodes(document, sorted(stored))
    return document, read_rig(document, rig.node)


def _look(document: Document, value: Any) -> Any:
    """A material, or a part of one, without names; textures are their images."""
    if not isinstance(value, dict):
        return value
    look = {key: _look(document, each) for key, each in value.items() if key not in ("name", "extras")}
    number, textures = look.get("index"), document.items("textures")
    if isinstance(number, int) and 0 <= number < len(textures):
        look["index"] = _look(document, textures[number])
    return look


def _meeting(starts: Floats, rays: Floats, corners: Floats, box: tuple[Floats, Floats]) -> int:
    """Count the (starts, 3) whose (starts, 3) rays meet triangles of (triangles, 3, 3) corners within their length."""
    low, high = box
    near = (corners.min(axis=1) <= high).all(axis=1) & (corners.max(axis=1) >= low).all(axis=1)
    numbers, _, distances = ray_hits(starts, rays, corners[near])
    return len(distinct_values(numbers[distances < 1.0]))
