"""The relief of a tool at the texels of a texture: heights, and the turns of normals, from the tool's own functions.

A texel has a place (u, v) on the tool's patch, and so a height for each of its shapes, at weight 1: no vertex is moved,
and the result is as sharp as the texels. Source: as `effects.wrinkle.carry`, whose vertices are texels here.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.character.pose import Pose, blend, transform
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.shapes import LEAST_COSINE, turn_to
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.shapes import REST_SHARE
from wrinklecli.numeric.arrays import Bools, Floats, Ints, determinants, distinct_values, flags_of, inverses, unit
from wrinklecli.surface.rest import carried_normals

# Factors on the height below which they are not told from 0.
_LEAST_FACTOR = 1e-9
# Texels that are held at once.
_CHUNK = 2**16


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
    """A tool's shapes at weight 1 at texels.

    Attributes:
        heights: (shapes, texels) scene units at rest.
        slopes: (shapes, texels, 2) the wrinkled normal over its part along the plain one: −∂h/∂t and −∂h/∂b along the
            tangent and the bitangent. The sum over shapes by weights, and 1, is the direction of the normal.
    """

    heights: Floats
    slopes: Floats


@dataclass(frozen=True, slots=True)
class _State:
    """A pose in which normals are to be right, as those of morph targets are fitted.

    Attributes:
        blended: (vertices, 3, 4) bind to world space.
        posed: (vertices, 3) world positions.
        smooth: (vertices, 3) unit normals of the posed surface.
        share: Its weight beside other states.
    """

    blended: Floats
    posed: Floats
    smooth: Floats
    share: float

    @classmethod
    def of(cls, plan: MeshPlan, vertices: Ints, pose: Pose, share: float) -> "_State":
        """The fine vertices of a mesh in a pose."""
        fine = plan.fine
        around = distinct_values(fine.triangles[fine.around.faces_of(vertices)])
        deltas = fine.morph_deltas[: len(pose.morph_weights), around]
        bind = fine.positions[around] + np.tensordot(pose.morph_weights, deltas, axes=1)
        blended = blend(fine.dense_weights(around, fine.weights.shape[1]), pose.matrices[None])[0]
        posed = np.zeros(fine.positions.shape)
        posed[around] = transform(blended[None], bind)[0]
        own = blended[np.searchsorted(around, vertices)]
        # A mirrored pose turns the winding inside out.
        outward = np.sign(determinants(own[:, :, :3]))[:, None]
        return cls(own, posed[vertices], outward * fine.around.normals_at(posed, vertices), share)


class ReliefOf:
    """A tool on a refined mesh, ready to be evaluated anywhere on its triangles."""

    def __init__(self, plan: MeshPlan, carried: CarriedPatch, pose: Pose) -> None:
        """Prepare the values at vertices; normals will be right in `pose`."""
        fine, patch = plan.fine, carried.patch
        self.patch: Patch = patch
        self.curve = patch.curve
        moved = fine.triangles[fine.around.faces_of(carried.vertices)]
        self.vertices: Ints = np.unique(moved)
        local = np.searchsorted(self.vertices, moved)
        self.places, self.facing = fine.posed_at(patch.pose, self.vertices)
        u, v = patch.coordinates(self.places)
        raw = patch.places(u, v, patch.cosines(u, self.facing)).factors
        factors = np.zeros(len(self.vertices))
        factors[np.searchsorted(self.vertices, carried.vertices)] = carried.places.factors
        known = np.abs(raw) > _LEAST_FACTOR
        self.left: Floats = _spread(np.where(known, factors / np.where(known, raw, 1.0), 0.0), known, local)
        rest_normals = fine.rest_normals_at(self.vertices)
        rows = self.vertices
        self.raised: Floats = np.einsum("vij,vj->vi", inverses(fine.blended[rows]), rest_normals)
        self.states = (_State.of(plan, rows, pose, 1.0), _State.of(plan, rows, plan.rest.pose, REST_SHARE))

    def covers(self, triangles: Ints, count: int) -> Bools:
        """(triangles,) True for triangles whose corners the tool knows."""
        known = flags_of(self.vertices, count)
        found: Bools = np.logical_and.reduce(known[triangles], axis=1)
        return found

    def at(self, textured: Textured, faces: Ints, shares: Floats) -> Relief:
        """Evaluate (texels,) triangles at (texels, 3) barycentric coordinates."""
        parts = [
            self._part(textured, faces[start : start + _CHUNK], shares[start : start + _CHUNK])
            for start in range(0, max(len(faces), 1), _CHUNK)
        ]
        return Relief(
            np.concatenate([each.heights for each in parts], axis=1),
            np.concatenate([each.slopes for each in parts], axis=1),
        )

    def _part(self, textured: Textured, faces: Ints, shares: Floats) -> Relief:
        rows = np.searchsorted(self.vertices, textured.triangles[faces])
        steps = textured.steps[faces]

        def heights(at: Floats) -> Floats:
            """(shapes, texels) at (texels, 3) coordinates, which may lie a little outside."""
            places, facing = _mixed(self.places[rows], at), unit(_mixed(self.facing[rows], at))
            u, v = self.patch.coordinates(places)
            left = np.clip(np.einsum("tk,tk->t", self.left[rows], at), 0.0, None)
            found = self.patch.places(u, v, self.patch.cosines(u, facing)).times(left)
            scaled = found.shapes(self.curve) * self.curve.greatest_amplitudes[..., None] * found.factors
            return scaled.reshape(-1, len(at))

        here = heights(shares)
        changes = [heights(shares + steps[:, k] / 2) - heights(shares - steps[:, k] / 2) for k in range(2)]
        frame = _inverse_frames(textured, faces, shares)
        normals = unit(_mixed(textured.normals[faces], shares))
        wanted, leverage = np.zeros((len(here), len(faces), 2)), np.zeros((len(here), len(faces), 1))
        for state in self.states:
            blended = _mixed(state.blended[rows], shares)
            shown = carried_normals(blended, normals)
            # The surface of the pose and the direction of the displacement, and their changes by a texel.
            corners = np.einsum("vkij,vkj->vki", state.blended[rows][..., :3], self.raised[rows])
            raised = _mixed(corners, shares)
            turning = [_mixed(corners, steps[:, k]) for k in range(2)]
            smooth = unit(_mixed(state.smooth[rows], shares))
            along = [_mixed(state.posed[rows], steps[:, k]) for k in range(2)]
            along = [each - np.sum(each * smooth, axis=1, keepdims=True) * smooth for each in along]
            outward = np.sign(np.sum(np.cross(along[0], along[1]) * smooth, axis=1))[:, None]
            for shape, height in enumerate(here):
                sides = [
                    side + change[shape][:, None] * raised + height[:, None] * turn
                    for side, change, turn in zip(along, changes, turning, strict=True)
                ]
                true = unit(outward * np.cross(sides[0], sides[1]))
                back = unit(np.einsum("vji,vj->vi", blended[..., :3], turn_to(smooth, shown, true)))
                parts = np.einsum("vij,vj->vi", frame, back)
                cosines = np.maximum(parts[:, 2:], LEAST_COSINE)
                weights = state.share * cosines**4
                wanted[shape] += weights * parts[:, :2] / cosines
                leverage[shape] += weights
        return Relief(here, wanted / leverage)


def _spread(values: Floats, known: Bools, triangles: Ints) -> Floats:
    """Give vertices without a value the mean of their neighbours that have one, ring by ring; 1 if there is none."""
    values, known = values.copy(), known.copy()
    while not known.all():
        sums, counts = np.zeros(len(values)), np.zeros(len(values))
        for shift in (1, 2):
            others = np.roll(triangles, shift, axis=1)
            np.add.at(sums, triangles, np.where(known, values, 0.0)[others])
            np.add.at(counts, triangles, known[others].astype(np.float64))
        new = ~known & (counts > 0)
        if not new.any():
            values[~known] = 1.0
            break
        values[new] = sums[new] / counts[new]
        known |= new
    return values


def _mixed(corners: Floats, shares: Floats) -> Floats:
    """(texels, …) of (texels, 3, …) corner values by (texels, 3) shares."""
    mixed: Floats = np.einsum("tk...,tk->t...", corners, shares)
    return mixed


def _inverse_frames(textured: Textured, faces: Ints, shares: Floats) -> Floats:
    """(texels, 3, 3) matrices from bind space to tangent, bitangent and normal, interpolated as MikkTSpace asks."""
    normals, tangents = (_mixed(each[faces], shares) for each in (textured.normals, textured.tangents))
    bitangents = textured.hands[faces][:, None] * np.cross(normals, tangents)
    return inverses(np.stack([unit(tangents), unit(bitangents), unit(normals)], axis=2))
