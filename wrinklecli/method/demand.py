"""What the line under a path asks its control curve for while a joint bends, so that the surface keeps its length.

The control curve keeps its length above a straight line. Skin on the inside of a bend is no straight line: whatever
rises above a concave line gets shorter, linear blend skinning shrinks heights there, and distances of anchors cut the
corners of what lies between. So the joint below a path is turned, the lengths of its line with wrinkles of all heights
are measured, and the curve takes up as much as leaves the line as long as it was. Above a straight line that is the
shortening itself: there, and where nothing bends, the curve is exact as it is.

Not in the paper, whose tools are straight; those stay as they are there.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, node_matrices, transform
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.method.activity import lengths_over_time
from wrinklecli.method.bending import MOMENTS, bent_node, turns_of
from wrinklecli.method.curve import TAUT, ControlCurve
from wrinklecli.method.patch import Patch
from wrinklecli.method.path import Curve
from wrinklecli.method.rest import Rest
from wrinklecli.numeric.arrays import Floats, inverses, singular, unit
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

# Where along a path the joint is that bends it: one beside an end turns all of it.
_BETWEEN = (0.1, 0.9)
# Every so many of a path's samples is a place of the line.
_EVERY = 2
# Points of the line on each control interval: its length is right to 1e-3 of what wrinkles add.
_POINTS = 16
# Wrinkles whose line is measured: roots of the share of the rest length that they take up.
_TRIED = np.linspace(0.0, 0.985, 65)
# Share by which ends come closer from one row to the next, at least.
_LEAST_STEP = 1e-4


def demand_of(patch: Patch, surface: Surface, rest: Rest, rig: Rig) -> Floats | None:
    """(2, rows) as `ControlCurve.demand`; None for straight tools, and where no joint bends a path.

    Args:
        patch: The tool; its members are not looked at.
        surface: The coarse mesh.
        rest: Its rest pose.
        rig: Its joints.
    """
    path = patch.path
    if not isinstance(path, Curve) or isinstance(patch.tool.rest_length, RestLengthKeys | RestLengthMorph):
        return None
    node = bent_node(patch, rig)
    if node is None:
        return None
    place = node_matrices(rig, None, np.zeros(1), [node])[0, 0, :3, 3]
    if not _BETWEEN[0] < path.locate(place).u < _BETWEEN[1]:
        return None
    line = _Line.of(path, surface, rest, len(rig.joints))
    if line is None:
        return None
    times, motion, shares = _bend(patch, rig, rest, node)
    curve = _unlimited(patch.curve)
    us = np.linspace(0.0, 1.0, _POINTS * curve.interval_count + 1)
    lengths = np.full(len(_TRIED), curve.rest_length)
    heights = np.einsum("tgm,gmu->tu", curve.follow((1.0 - _TRIED**2) * lengths, lengths)[0], curve.shapes(us))
    wanted = line.length * curve.rest_length / patch.span
    roots, asked = [0.0], [0.0]
    for points, directions, share in zip(*line.posed(rig, motion, times, us), shares, strict=True):
        steps = np.diff(points + heights[..., None] * directions, axis=1)
        found = np.maximum.accumulate(np.sqrt(np.einsum("tux,tux->tu", steps, steps)).sum(axis=1))
        # Beyond what wrinkles of any height make up for, or make longer at once, nothing is asked for.
        if found[0] < wanted < found[-1]:
            roots.append(float(np.sqrt(share)))
            asked.append(max(asked[-1], float(np.interp(wanted, found, _TRIED))))
    if len(roots) == 1:
        return None
    return np.array([[*roots, np.sqrt(TAUT)], [*asked, np.sqrt(TAUT)]])


def _unlimited(curve: ControlCurve) -> ControlCurve:
    """A curve of incompressible tissue, whose bumps have no greatest height unless one rises after another."""
    height = np.inf if len(curve.groups) == 1 else curve.max_height
    return replace(curve, compressible=0.0, max_height=height)


def _bend(patch: Patch, rig: Rig, rest: Rest, node: int) -> tuple[Floats, Clip, Floats]:
    """The turn that brings a tool's ends together, as long as it does.

    Returns:
        (rows,) times, the motion, and (rows,) the share by which the ends are closer than the rest length, rising.
    """
    times = np.linspace(0.0, 1.0, MOMENTS)
    turns = turns_of(patch, rig, node)
    every = []
    for motion in turns:
        distances, lengths = lengths_over_time(patch, rig, rest, motion, times)
        every.append(np.maximum(TAUT - distances / lengths, 0.0))
    chosen = int(np.argmax([shares.max() for shares in every]))
    shares = every[chosen]
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(shares), prepend=0.0) > _LEAST_STEP)
    return times[rising], turns[chosen], shares[rising]


@dataclass(frozen=True, slots=True)
class _Line:
    """The line of the surface under a path.

    Attributes:
        us: (places,) along the path.
        weights: (places, joints) skin weights.
        points: (1 + morph targets, places, 3) as they are stored, bind space.
        directions: (places, 3) what wrinkles rise along, bind space, as long as 1 in world space at rest.
        length: At rest, scene units.
    """

    us: Floats
    weights: Floats
    points: Floats
    directions: Floats
    length: float

    @classmethod
    def of(cls, path: Curve, surface: Surface, rest: Rest, joint_count: int) -> "_Line | None":
        """The line under a path at rest; none where its joints are singular there."""
        feet = [rest.blocks.closest_point(point)[:2] for point in path.points[::_EVERY]]
        corners = surface.triangles[[triangle for triangle, _ in feet]]
        shares = np.stack([barycentrics for _, barycentrics in feet])

        def mixed(values: Floats) -> Floats:
            found: Floats = np.einsum("pc,pcx->px", shares, values)
            return found

        of_corners = surface.dense_weights(corners.reshape(-1), joint_count).reshape(*corners.shape, -1)
        weights = mixed(of_corners)
        blended = blend(weights, rest.matrices[None])[0]
        if singular(blended).any():
            return None
        normals = unit(mixed(rest.normals_at(corners.reshape(-1)).reshape(*corners.shape, 3)))
        stored = np.concatenate([surface.positions[None], surface.morph_deltas])
        placed = transform(blended[None], mixed(rest.bind_positions[corners]))[0]
        return cls(
            us=path.ways[::_EVERY] / path.length,
            weights=weights,
            points=np.stack([mixed(each[corners]) for each in stored]),
            directions=np.einsum("pij,pj->pi", inverses(blended), normals),
            length=float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()),
        )

    def posed(self, rig: Rig, motion: Clip, times: Floats, us: Floats) -> tuple[Floats, Floats]:
        """(frames, points, 3) where (frames,) seconds of a motion take it at (points,) us, and its directions."""
        blended = blend(self.weights, joint_matrices(rig, motion, times))
        morphed = self.points[0] + np.tensordot(morph_weights(rig, motion, times), self.points[1:], axes=1)
        turned = np.einsum("fpij,pj->fpi", blended[..., :3], self.directions)
        # Straight from place to place.
        behind = np.clip(np.searchsorted(self.us, us), 1, len(self.us) - 1)
        t = ((us - self.us[behind - 1]) / (self.us[behind] - self.us[behind - 1]))[:, None]
        placed = transform(blended, morphed)
        points, directions = (
            each[:, behind - 1] + t * (each[:, behind] - each[:, behind - 1]) for each in (placed, turned)
        )
        return points, directions
