"""The relief of a tool at the texels of a texture, taken from a mesh that is refined more finely than a bake's.

A texel lies on a fine triangle. Its heights are mixed from those of the corners, and so are its normals, which are
those of the fine mesh's morph targets: an engine would draw the same. The tool's own functions at each texel would show
the borders of triangles, where factors on the height have kinks, as combs.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.baking.job import Job
from wrinklecli.character.contacts import Neighbours
from wrinklecli.effects.effect import Effect, MeshPlan, SamplingOptions
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.effects.shapes import turn_to
from wrinklecli.errors import BakeError, TooMuchError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, distinct_values, flags_of, inverses, renumbered, unit
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.fields import Field
from wrinklecli.tools.records import WrinkleTool

# Edges on half a bump, tried in this order. With 12, normals are within 1.4° of those of 24 at 95 % of a tool on the
# samples' wrist, head and trousers. Where a clip folds a low-poly leg along the edges of its own triangles, its surface
# has a kink that no number of edges rounds: there those of 12 and 24 are 2.6° apart, and 1.0° with the leg unfolded.
_EDGES = (12, 8, 6)
# Times that an edge of the asset is halved at most, as a tools file may ask for.
_LEVELS = 8
# New vertices of one tool at most: twice as many take 7 s and 0.9 GB.
_MOST_VERTICES = 100_000


def plan_finely(
    job: Job, node: int, tool: WrinkleTool | Field, neighbours: Neighbours, how: SamplingOptions, *, most_edges: float
) -> tuple[MeshPlan, Effect]:
    """Refine the mesh of a node under one tool as finely as maps need, whatever the tools file asks for.

    No file holds that mesh, so its new vertices may have any number of joints. A tool for which it would be too large
    gets fewer edges, and at last those of the tools file.

    Args:
        job: The asset and its tools.
        node: The node.
        tool: The tool.
        neighbours: The neighbours in the asset.
        how: The options of sampling.
        most_edges: The edges on half a bump that a texture can show: as many as there are samples.

    Raises:
        WrinkleError: As `plan_mesh`.
    """
    own = job.settings.refinement
    finer = [
        (replace(own, edges_per_interval=edges, max_levels=_LEVELS), _MOST_VERTICES)
        for edges in _EDGES
        if own.edges_per_interval < edges <= most_edges
    ]
    for refinement, most in [*finer, (own, job.options.max_vertices)]:
        settings = replace(job.settings, refinement=refinement)
        try:
            plan = plan_mesh(
                job.document,
                node,
                [tool],
                settings,
                job.every_clip,
                job.options.max_error,
                max_vertices=most,
                neighbours=neighbours,
                stored=False,
            )
            plan = replace(plan, has_normals=True)  # maps show normals, also of a mesh that has none
            (effect,), _ = sample_effects(plan, [], how)
        except (BakeError, TooMuchError):
            if refinement is own:
                raise
        else:
            return plan, effect
    raise AssertionError


@dataclass(frozen=True, slots=True)
class Textured:
    """The corners of fine triangles with what a texture needs of them.

    Attributes:
        triangles: (triangles, 3) fine welded vertices.
        normals: (triangles, 3, 3) NORMALs, bind space.
        tangents: (triangles, 3, 3) TANGENTs.
        hands: (triangles,) their handedness.
        steps: (triangles, 2, 3) as `texture_steps`.
    """

    triangles: Ints
    normals: Floats
    tangents: Floats
    hands: Floats
    steps: Floats


@dataclass(frozen=True, slots=True)
class Relief:
    """A tool's shapes at weight 1 on a fine mesh.

    Attributes:
        fine: The mesh.
        numbers: Those of the targets of the shapes.
        vertices: (vertices,) fine welded vertices that move or turn, sorted.
        heights: (shapes, vertices) scene units at rest, along the normal.
        turns: (shapes, vertices, 3) what is added to the unit bind normal, across it.
    """

    fine: Refinement
    numbers: tuple[int, ...]
    vertices: Ints
    heights: Floats
    turns: Floats

    @classmethod
    def of(cls, effect: Effect, fine: Refinement) -> "Relief":
        """Take the shapes of an effect on a mesh."""
        shapes = [each.shape for each in effect.targets]
        changed = [part for each in shapes for part in (each.vertices, each.normal_vertices)]
        vertices = distinct_values(np.concatenate([np.zeros(0, np.intp), *changed]))
        heights, turns = np.zeros((len(shapes), len(vertices))), np.zeros((len(shapes), len(vertices), 3))
        for row, shape in enumerate(shapes):
            moves = np.einsum("vij,vj->vi", fine.blended[shape.vertices, :, :3], shape.deltas)
            normals = fine.rest_normals_at(shape.vertices)
            heights[row, np.searchsorted(vertices, shape.vertices)] = np.einsum("vx,vx->v", moves, normals)
            turns[row, np.searchsorted(vertices, shape.normal_vertices)] = shape.normal_deltas
        return cls(fine, tuple(each.number for each in effect.targets), vertices, heights, turns)

    def covers(self, triangles: Ints) -> Bools:
        """(triangles,) True for those of which a corner moves or turns."""
        return any_of(flags_of(self.vertices, len(self.fine.positions)), triangles)

    def at(self, textured: Textured, faces: Ints, shares: Floats) -> tuple[Floats, Floats]:
        """Heights and slopes at (texels,) triangles and (texels, 3) barycentric coordinates in them.

        Returns:
            (shapes, texels) heights, scene units at rest.
            (shapes, texels, 2) the wrinkled normal over its part along the plain one: −∂h/∂t and −∂h/∂b along the
            tangent and the bitangent. The sum over shapes by weights, and 1, is the direction of the normal.
        """
        parts = [self._part(textured, faces[part], shares[part]) for part in portions(max(len(faces), 1), 2)]
        heights, slopes = zip(*parts, strict=True)
        return np.concatenate(heights, axis=1), np.concatenate(slopes, axis=1)

    def _part(self, textured: Textured, faces: Ints, shares: Floats) -> tuple[Floats, Floats]:
        used, rows = renumbered(faces)
        corners = textured.triangles[used].reshape(-1)
        at = np.minimum(np.searchsorted(self.vertices, corners), len(self.vertices) - 1)
        known = self.vertices[at] == corners
        base, authored = self.fine.normals_at(corners), unit(textured.normals[used].reshape(-1, 3))
        # (texels, 3, 3) matrices from bind space to tangent, bitangent and normal, interpolated as MikkTSpace asks.
        normals, tangents = (_mixed(each[faces], shares) for each in (textured.normals, textured.tangents))
        bitangents = textured.hands[faces][:, None] * np.cross(normals, tangents)
        frames = inverses(np.stack([unit(tangents), unit(bitangents), unit(normals)], axis=2))
        along = np.einsum("tij,tj->ti", frames, _mixed(authored.reshape(-1, 3, 3)[rows], shares))[:, 2:]
        heights, slopes = np.zeros((len(self.heights), len(faces))), np.zeros((len(self.heights), len(faces), 2))
        for shape, (raised, turns) in enumerate(zip(self.heights, self.turns, strict=True)):
            of_corners = np.where(known, raised[at], 0.0).reshape(-1, 3)
            heights[shape] = _mixed(of_corners[rows], shares)
            turned = turn_to(base, authored, np.where(known[:, None], turns[at], 0.0))
            across = np.einsum("tij,tj->ti", frames, _mixed(turned.reshape(-1, 3, 3)[rows], shares))
            slopes[shape] = across[:, :2] / along
        return heights, slopes


def _mixed(corners: Floats, shares: Floats) -> Floats:
    """(texels, …) of (texels, 3, …) corner values by (texels, 3) shares."""
    return np.asarray(np.einsum("tk...,tk->t...", corners, shares))
