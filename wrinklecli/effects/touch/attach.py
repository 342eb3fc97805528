"""Touches attached to a body at rest: the place, the slide of its skin, the dent, and the rings of wrinkles."""

from collections.abc import Sequence
from dataclasses import field, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.surface import influence_count
from wrinklecli.drive.touch import TouchDrive, TouchPlace, turned
from wrinklecli.effects.attached import Attached, Drag, Moves
from wrinklecli.effects.touch.bending import LEAST_CHANGE, Bending, bending_of
from wrinklecli.effects.touch.disc import Disc, disc_on
from wrinklecli.effects.touch.rings import Rings, plan_rings
from wrinklecli.effects.touch.skin import NO_PATCH, Hold, Patch, Place, hold_of, slides_on, slides_on_surface
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, inverses, singular, smoothstep, unit
from wrinklecli.numeric.membrane import stretches
from wrinklecli.numeric.spring import Spring
from wrinklecli.surface.anchor import carried_by_joints, check_size, foot_of
from wrinklecli.surface.bones import BoneLines, carried_by
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import read_mask
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.surface.rest import Rest, asked_positions, named_node
from wrinklecli.tools.body import Touch
from wrinklecli.tools.records import ToolsFile

FOLDED, TURNED = -0.7, -0.95
"""Strains at the greatest slide below which a warning says so, and below which a bake is refused: at -1 triangles turn
over."""

# Radius of the dent over the pad's: skin bends over more than the tip's own width.
_DENT = 1.5
# Radius round the middle in which the skin's bend is fitted, over the pad's.
_BENT = 1.5
# Height of the skin beyond that by the parts of a slide, over the slide, from which on ways are turned.
_ASLANT = 0.01
# Steps between two points of a path in which its way on the skin is found.
_STEPS = 32
# Least way between two points of a path, and distance of two places, over the pad.
_LEAST_WAY, _APART = 0.5, 2.0
# Most places of a path: 24 targets are few enough for a phone beside those of other effects.
_MOST_PLACES = 8
# Intervals across the pad that the slide needs; rings are finer.
_ACROSS = 6.0
# Directions in which the strain is looked at.
_DIRECTIONS = 8


@dataclass(frozen=True, slots=True, eq=False)
class AttachedPlace:
    """A place of a touch on the mesh at rest.

    Attributes:
        place: Where it is.
        hold: How the coarse skin is held.
        bending: The joint that bends its skin; None if none does, and in a row.
        disc: The region that is refined.
        rings: The rings; None for a slide alone.
        patch: The skin on which it was fitted.
        fitted: (targets, vertices of the patch, 3) displacements at weight 1, bind space.
    """

    place: Place
    hold: Hold
    disc: Disc
    bending: Bending | None = None
    rings: Rings | None = None
    patch: Patch = NO_PATCH
    fitted: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class AttachedTouch(Attached[Touch]):
    """A touch on the mesh at rest.

    Attributes:
        tool: The touch of the tools file.
        places: One, or those of a row in order.
        drive: The names of the targets, and their weights.
        strain: The greatest compression at the greatest slide, from 0 to -1 and below.
    """

    tool: Touch
    places: tuple[AttachedPlace, ...]
    drive: TouchDrive
    strain: float

    covers: ClassVar[tuple[str, ...]] = ()

    @property
    def span(self) -> float:
        """The tip's radius."""
        return self.drive.pad

    @property
    def keyed_clips(self) -> tuple[str, ...]:
        """The clips that key it, or in which a node touches."""
        return (*self.drive.keys, *self.drive.ends)

    @property
    def rings(self) -> Rings | None:
        """The rings, in a row those of the tallest place; None for a slide alone."""
        found = [each.rings for each in self.places if each.rings is not None]
        return max(found, key=lambda each: each.tallest, default=None)

    @property
    def drag(self) -> Drag:
        """The tip."""
        folding, place = self.drive.grip * FOLDED / self.strain if self.strain < 0.0 else np.inf, self.places[0].place
        return Drag(self.drive, place.at, place.pad + place.reach, folding)

    @property
    def deltas(self) -> Floats:
        """(targets, vertices, 3) displacements at weight 1 on the coarse skin, bind space."""
        return np.concatenate([each.patch.spread(each.fitted, len(each.hold.still)) for each in self.places])

    @property
    def moves(self) -> Moves:
        """The targets on the coarse skin, and on refined skin."""
        return Moves(self.drive, self.deltas, self.deltas_on)

    def deltas_on(self, fine: Refinement) -> Floats:
        """(targets, fine vertices, 3) displacements at weight 1 on refined skin, bind space."""
        found = []
        for each in self.places:
            patch = Patch.of(fine, each.hold)
            known = patch.equals(each.patch)
            found.append(patch.spread(each.fitted, len(fine.positions)) if known else _deltas(each, self.drive, fine))
        return np.concatenate(found)

    @property
    def regions(self) -> tuple[Disc, ...]:
        """The discs, each once for each axis."""
        return tuple(disc for each in self.places for disc in each.disc.both)

    @property
    def greatest_height(self) -> float:
        """The height of the tallest ring, in which errors show most; without rings the slide."""
        tallest = 0.0 if self.rings is None else self.rings.tallest
        return tallest or self.drive.grip


def attach_touch(tool: Touch, ground: Ground, settings: ToolsFile) -> AttachedTouch:
    """Attach a touch to a mesh.

    Raises:
        WrinkleError: It does not fit.
    """
    places, spacing = _places(tool, ground, settings)
    soft = _softness(tool, ground)
    grip, deepest = tool.grip.resolve(tool.pad), tool.press.resolve(tool.pad)
    held = [_held(tool, place, ground, soft) for place in places]
    fine = refine(
        ground.surface,
        ground.rest,
        tuple(disc for each in held for disc in each.disc.both),
        ground.rig,
        settings=settings.refinement,
        contacts=ground.contacts.held,
        influences=influence_count(ground.document, ground.rig),
        poses=replace(ground.poses, clips=()),
        tolerance=np.inf,
    )
    slides = [slides_on(fine, fine.rest_positions, each.place, each.hold) for each in held]
    if not all(each.any(axis=(1, 2)).all() for each in slides):
        raise BakeError("does not move the skin there: nothing of it is free to slide", where=tool.place_of(0))
    bending = changes = None
    if not spacing:
        coarse = slides[0][:, : len(ground.rest.positions)]
        bending = bending_of(ground, held[0].place, held[0].hold, soft, coarse)
        changes = None if bending is None else bending.changes(fine, slides[0])
        if changes is None or np.sqrt((changes**2).sum(axis=3)).max() < LEAST_CHANGE:
            bending = changes = None
    bends = [_bend(fine, place, max(_BENT * place.pad, spacing)) for place in places]
    drive = TouchDrive(
        name=tool.name,
        places=tuple(
            TouchPlace(_anchors(ground, place), bend, np.zeros(0), np.array([[0.0, 0.0], [1.0, 1.0]]))
            for place, bend in zip(places, bends, strict=True)
        ),
        pad=tool.pad,
        grip=grip,
        deepest=deepest,
        release=Spring(2.0 * np.pi * tool.release.frequency, tool.release.damping),
        targets=(),
        keys={clip: np.array(keys) for clip, keys in tool.keys.items()},
        tip=_tip(tool, ground),
        turn=0.0 if spacing else _turn(bends[0], grip),
        limb=None if bending is None else bending.limb,
        spacing=spacing,
    )
    drive = replace(drive, ends=drive.ends_in(ground.rig.own, ground.clips))
    if tool.wrinkles is not None:
        main = None if spacing else _main_direction(drive, ground)
        skin = fine.rest_positions, fine.rest_normals
        held = [
            replace(each, rings=plan_rings(tool, tool.wrinkles, each.place, grip, main, number, slid, *skin))
            for number, (each, slid) in enumerate(zip(held, slides, strict=True))
        ]
        drive = replace(
            drive,
            places=tuple(
                replace(place, windows=each.rings.angles, rises=each.rings.rises)
                for place, each in zip(drive.places, held, strict=True)
                if each.rings is not None
            ),
        )
    drive = replace(drive, targets=tool.target_names(_count(drive)))
    strain = min(_strain(fine, slid * grip) for slid in slides)
    if strain < TURNED:
        raise BakeError(
            f"is {grip:.4g}, which would fold the skin over: its strain would be {strain:.2f}, where -1 turns triangles"
            f" over; up to {grip * -FOLDED / -strain:.3g} it looks well",
            where=tool.place("grip"),
        )
    fitted = []
    for each, slid in zip(held, slides, strict=True):
        patch, bare = Patch.of(fine, each.hold), replace(each, bending=bending)
        fitted.append(replace(bare, patch=patch, fitted=_deltas(bare, drive, fine, slid, changes)[:, patch.vertices]))
    return AttachedTouch(tool, tuple(fitted), drive, strain)


def _held(tool: Touch, place: Place, ground: Ground, soft: Floats | None) -> AttachedPlace:
    """A place with the hold on its skin and the disc that is refined."""
    hold = hold_of(ground, place, soft)
    disc = disc_on(ground.rest, place, *_size(tool, place), hold.still)
    triangle, _, _ = ground.rest.closest_point(place.at)
    if not len(disc.members) or (hold.still[ground.rest.triangles[triangle]] == 1).all():
        raise BakeError(
            "does not move the skin there: another mesh touches it, or the mask is 0", where=tool.place_of(0)
        )
    return AttachedPlace(place, hold, disc)


def _size(tool: Touch, place: Place) -> tuple[float, float, float]:
    """Radius of the disc, the intervals across it, and the greatest displacement along the normals, scene units."""
    wanted = tool.wrinkles
    if wanted is None:
        radius = place.pad + place.reach
        return radius, _ACROSS * radius / place.pad, tool.press.resolve(place.pad)
    length = wanted.length.resolve(place.reach)
    radius = place.pad + length
    return radius, 2.0 * radius * 2.0 * wanted.bumps / length, wanted.bump_height * length / wanted.bumps


def _softness(tool: Touch, ground: Ground) -> Floats | None:
    """(vertices,) factors of a mask; None without one."""
    mask = read_mask(tool, ground, np.arange(len(ground.surface.triangles)))
    return None if mask is None else mask.welded(ground.surface.weld, len(ground.surface.positions))


def _places(tool: Touch, ground: Ground, settings: ToolsFile) -> tuple[list[Place], float]:
    """The places of a touch on the skin, and their distance from each other: 0 for one place."""
    rest, size = ground.rest, ("pad", tool.pad)
    reach = tool.reach.resolve(tool.pad)
    check_size(tool, size, rest, "a quarter")
    if tool.pad > reach:
        raise BakeError(
            f"is {tool.pad:.4g}, and the reach is {reach:.4g}: the skin beside a tip slides farther than the tip is"
            " wide; the reach must be at least the pad",
            where=tool.place("pad"),
        )
    asked = asked_positions(ground.rig, rest, tool)
    numbers = (0, *range(len(asked) - len(tool.along) - (tool.by is not None), len(asked) - (tool.by is not None)))
    feet = np.stack([foot_of(tool, number, asked[number], rest, size, settings.up) for number in numbers])
    at, spacing = _row(tool, feet, numbers, rest) if tool.along else (feet, 0.0)
    ways = [asked[1] - at[0] if tool.towards is not None else _limb(ground, at[0])]
    if tool.along:
        ways = [*np.diff(at, axis=0), at[-1] - at[-2]]
    return [_place(tool, *each, rest, reach) for each in zip(at, ways, strict=True)], spacing


def _row(tool: Touch, feet: Floats, numbers: Sequence[int], rest: Rest) -> tuple[Floats, float]:
    """(places, 3) points at equal distances along the way through (points, 3) ones on the skin, and that distance.

    With two pads from place to place, rings that are left behind, as their place hands over, lie below the tip.
    """
    steps = np.linspace(0.0, 1.0, _STEPS, endpoint=False)[:, None]
    ways = [one + steps * (two - one) for one, two in pairwise(feet)]
    drawn = np.stack([rest.foot(point)[0] for point in (*np.concatenate(ways), feet[-1])])
    lengths = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(drawn, axis=0) ** 2, axis=1))))
    for number, length in zip(numbers[1:], np.diff(lengths[::_STEPS]).tolist(), strict=True):
        if length < _LEAST_WAY * tool.pad:
            raise BakeError(
                f"is {length:.3g} from the point before it, less than half of the pad of {tool.pad:.4g}",
                where=tool.place_of(number),
            )
    length = float(lengths[-1])
    count = int(np.ceil(length / (_APART * tool.pad))) + 1
    if count > _MOST_PLACES:
        raise BakeError(
            f"is {length:.4g} long and would take {count} places, {_APART:.0f} pads of {tool.pad:.4g} apart, of"
            f" {_MOST_PLACES} at most; a pad of {length / (_APART * (_MOST_PLACES - 1)):.3g} reaches along it",
            where=tool.place("along"),
        )
    at = np.linspace(0.0, length, count)
    points = np.stack([np.interp(at, lengths, column) for column in drawn.T], axis=1)
    return np.stack([rest.foot(point)[0] for point in points]), length / (count - 1)


def _place(tool: Touch, at: Floats, way: Floats, rest: Rest, reach: float) -> Place:
    """The place of a touch at a (3,) point of the skin, which faces a (3,) way."""
    triangle, _, _ = rest.closest_point(at)
    _, normal = rest.foot(at)
    if singular(rest.blended[rest.triangles[triangle]]).any() or not normal.any():
        raise BakeError("the joints here are singular at rest", where=tool.place_of(0))
    forward = way - (way @ normal) * normal
    length = float(np.linalg.norm(forward))
    if length < 1e-3 * float(np.linalg.norm(way)) or not length:
        if tool.towards is not None:
            raise BakeError("lies straight above or below the place, so it gives no direction", where=tool.place_of(1))
        forward = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    forward = unit(forward)
    # Mirrored keys slide to the other side.
    sideways = np.cross(normal, forward) * (-1.0 if tool.mirrored else 1.0)
    return Place(at, np.stack([forward, sideways, normal]), tool.pad, reach)


def _limb(ground: Ground, at: Floats) -> Floats:
    """(3,) the direction of the bone nearest to a place, away from its joint; 0 if there is none."""
    if not ground.rig.skinned:
        return np.zeros(3)
    bones = BoneLines.of(ground)
    number = bones.nearest(at)
    return np.asarray(bones.ends[number] - bones.starts[number])


def _count(drive: TouchDrive) -> int:
    """Count the targets of a touch."""
    count = sum(len(drive.slides) + len(place.windows) for place in drive.places)
    return count + (0 if drive.limb is None else TouchDrive.bent)


def _tip(tool: Touch, ground: Ground) -> CarriedPoint | None:
    """The tip, as its node carries it; None if there is none."""
    if tool.by is None:
        return None
    number = len(tool.points) - 1
    node = named_node(ground.rig, tool, number)
    return carried_by(ground, node, asked_positions(ground.rig, ground.rest, tool)[number])


def _bend(fine: Refinement, place: Place, radius: float) -> Floats:
    """(3,) the quadric that fits the skin within a radius of a place: its height above the tangent plane."""
    relative = fine.rest_positions - place.at
    near = np.sum(relative**2, axis=1) < radius**2
    near &= fine.rest_normals @ place.axes[2] > 0
    forward, sideways, height = place.axes @ relative[near].T
    columns = np.stack([forward**2, forward * sideways, sideways**2], axis=1)
    return np.asarray(np.linalg.lstsq(columns, height, rcond=None)[0], np.float64)


def _turn(bend: Floats, grip: float) -> float:
    """The angle from forward to the nearest main curvature of (3,) a quadric, radians; 0 where forward is good enough.

    Along the main curvatures, the height of the skin is a sum of a part that one way has and a part that the other has.
    """
    if abs(bend[1]) * grip / 2.0 < _ASLANT:
        return 0.0
    quarter = np.pi / 2.0
    turn = 0.5 * float(np.arctan2(bend[1], bend[0] - bend[2]))
    return round(turn - quarter * round(turn / quarter), 4)


def _main_direction(drive: TouchDrive, ground: Ground) -> float:
    """The direction in which the skin slides farthest in any clip, radians from forward."""
    strokes = [rows for clip in ground.clips for rows in drive.strokes_in(ground.rig.own, clip)]
    slides = np.concatenate([np.zeros((1, 2)), *(rows[:, 1:3] for rows in strokes)])
    farthest = slides[np.argmax((slides**2).sum(axis=1))]
    return float(np.arctan2(farthest[1], farthest[0]))


def _anchors(ground: Ground, place: Place) -> tuple[CarriedPoint, ...]:
    """The middle of a place, and points before, beside and above it, carried by the joints of the middle."""
    rest, rig, surface = ground.rest, ground.rig, ground.surface
    triangle, shares, _ = rest.closest_point(place.at)
    vertices = surface.triangles[triangle]
    weights = shares @ surface.dense_weights(vertices, len(rig.joints))
    joints = np.flatnonzero(weights > 0)
    blended = np.einsum("j,jab->ab", weights[joints], rest.matrices[joints])
    own = len(rig.own.morph_names)
    deltas = np.einsum("k,mkx->mx", shares, surface.morph_deltas[:own, vertices])
    found = []
    for offset in (np.zeros(3), *(place.pad * place.axes)):
        bind = np.linalg.solve(blended[:3, :3], place.at + offset - blended[:3, 3])
        bind = bind - np.tensordot(rest.morph_weights[:own], deltas, axes=1)
        points = np.zeros((1 + own, len(joints), 4))
        points[0] = weights[joints, None] * np.append(bind, 1.0)
        points[1:, :, :3] = weights[joints, None] * deltas[:, None]
        found.append(carried_by_joints(rig, rest, joints, points))
    return tuple(found)


def _strain(fine: Refinement, slides: Floats) -> float:
    """The greatest compression of the refined skin at (2, fine vertices, 3) greatest slides in any direction."""
    chosen = np.flatnonzero(np.any(slides, axis=(0, 2))[fine.triangles].any(axis=1))
    corners = fine.triangles[chosen]
    before = fine.rest_positions[corners]
    angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    moved = np.einsum("wd,dtkx->wtkx", np.stack([np.cos(angles), np.sin(angles)], axis=1), slides[:, corners])
    return float(stretches(before, before + moved).min(initial=1.0)) - 1.0


def _deltas(
    attached: AttachedPlace,
    drive: TouchDrive,
    fine: Refinement,
    slides: Floats | None = None,
    changes: Floats | None = None,
) -> Floats:
    """(targets, fine vertices, 3) displacements at weight 1 of a place's targets on refined skin, bind space."""
    place, rings = attached.place, attached.rings
    found = slides_on(fine, fine.rest_positions, place, attached.hold) if slides is None else slides

    def along_ways(slid: Floats) -> Floats:
        """(2, vertices, 3) parts forward and sideways, as parts along the drive's ways."""
        return np.tensordot(turned(drive.turn), slid, axes=1) if drive.turn else slid

    positions, normals = fine.rest_positions, fine.rest_normals
    moving = np.any(found, axis=(0, 2))
    distances, _ = place.polar(positions)
    dent = smoothstep(np.clip(1.0 - distances / (_DENT * place.pad), 0.0, 1.0)) * np.clip(normals @ place.axes[2], 0, 1)
    slid = [
        *slides_on_surface(positions, normals, drive.grip * along_ways(found)),
        (-drive.deepest * dent * moving)[:, None] * place.axes[2],
    ]
    parts = [np.stack([slid[number] for number in drive.slides])]
    if rings is not None:
        parts.append(rings.displacements(place, found, positions, normals) * moving[:, None])
    if attached.bending is not None:
        changed = attached.bending.changes(fine, found) if changes is None else changes
        for change in drive.grip * changed:
            along = along_ways(change)
            parts += [along, -along]
    whole = np.concatenate(parts)
    chosen = np.flatnonzero(np.any(whole, axis=(0, 2)) & ~singular(fine.blended))
    deltas = np.zeros(whole.shape)
    deltas[:, chosen] = np.einsum("vab,mvb->mva", inverses(fine.blended[chosen]), whole[:, chosen])
    return deltas
