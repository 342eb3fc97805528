"""A region of flesh on a mesh at rest: its joint, its shapes on the skin, and the springs that move these."""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import contacts_of
from wrinklecli.character.pose import node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.swing import GRAVITY, KEYS_ASKED, Mode, SwingDrive, keys_per_second, signed
from wrinklecli.effects.attached import Attached, Moves
from wrinklecli.effects.flesh.tissue import Body, NoFleshError, Place, Swings, swings_of
from wrinklecli.errors import BakeError, listed, unknown
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, components, determinants, inverses, smoothstep
from wrinklecli.numeric.closest import Tree, nearest_of
from wrinklecli.numeric.edges import numbered_edges
from wrinklecli.numeric.memory import once
from wrinklecli.numeric.spring import Spring
from wrinklecli.surface.anchor import check_size, foot_of
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.mask import read_mask
from wrinklecli.surface.region import Region
from wrinklecli.surface.rest import Rest, asked_positions
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import ToolsFile

# Mean weight of a joint below which it does not carry a region.
_CARRIES = 0.01
# Part of the weight of skin that must be on the joints of a region, if the mesh does not join both.
_SAME_JOINTS = 0.5
# Part of the radius over which moves fade towards skin of another mesh, from which the region would tear off.
_SEAM = 0.25
# Part of the radius in which another mesh is looked for, and how near over the skin it is part of what one wears, over
# the radius.
_COVERED, _CLOSE = 0.7, 0.3
# Least share of the largest move that a shape must make on the skin.
_LEAST_MOVE = 1e-6
# Part of the limit below which nobody sees a region move.
_SEEN = 0.02
# Body heights per second at which the ground runs below a clip in place: a slow walk has 0.4, a shifted foot 0.05. And
# the part of the ground's way within which such a body keeps its place: one that goes ahead gets as far as its feet do.
_RUNS, _SWAYS = 0.15, 0.25
# Samples per second, and at most, by which that is measured: a foot is down for a quarter of a second in a run.
_SAMPLED, _MOST_SAMPLES = 30.0, 300


@dataclass(frozen=True, slots=True, eq=False)
class AttachedFlesh(Attached[Flesh]):
    """A region on the mesh at rest.

    Attributes:
        tool: The region as the tools file has it.
        drive: The springs, with the names of the targets.
        deltas: (targets, vertices, 3) of the coarse surface, bind space, at weight 1; the last is minus the sum of the
            others.
        limit: The length to which moves are capped, scene units.
        swings: The shapes on the grid.
        place: Where the region is.
        factors: (modes,) from the shapes of the grid to the moves of the targets.
        follows: (vertices,) factors from 0 to 1: how far the skin of the region's own mesh follows the shapes.
        covers: Names of other meshes that lie over the region and do not swing; none for a mesh that moves with it.
        down: (3,) all of gravity at rest in the space of the joint, scene units per second squared.
    """

    tool: Flesh
    drive: SwingDrive
    deltas: Floats
    limit: float
    swings: Swings
    place: Place
    factors: Floats
    follows: Floats
    covers: tuple[str, ...]
    down: Floats
    moves: Moves = field(init=False)

    regions: ClassVar[tuple[Region, ...]] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "moves", Moves(self.drive, self.deltas, tuned=self.driven_as))

    @property
    def span(self) -> float:
        """The region's radius."""
        return self.place.radius

    @property
    def greatest_height(self) -> float:
        """The length to which moves are capped."""
        return self.limit

    def clip_warnings(self, rig: Rig, clips: Sequence[tuple[Clip, Floats]]) -> list[str]:
        """Warnings about too few keys, clothes that stay, and clips in place."""
        name, joint, warnings = self.tool.name, rig.names[self.drive.node], []
        if self.tool.carrier is not None:
            return []  # those of the region's own mesh say it
        sparse = [(keys_per_second(rig, clip, self.drive.node), clip.name) for clip, _ in clips]
        few = [(keys, clip) for keys, clip in sparse if keys < KEYS_ASKED]
        if few:
            warnings.append(
                f"{name}: {listed([clip for _, clip in few])} has {min(few)[0]:.3g} keys a second for {joint!r}"
                f" and what it hangs on; below {KEYS_ASKED:g}, flesh swings as the keys do and not as the body would:"
                " export the clip with a key for each frame"
            )
        if self.covers:
            stay = "stays" if len(self.covers) == 1 else "stay"
            warnings.append(
                f"{name}: {listed(self.covers)} over it {stay} in place: the skin may come through; `meshes` lets"
                " clothes move along"
            )
        still = bool(clips) and all(moves_of(weights).max(initial=0.0) < _SEEN for _, weights in clips)
        # Of clips in place, the layer has told.
        if still and not any(in_place(rig, clip) for clip, _ in clips):
            warnings.append(
                f"{name}: hardly moves in {listed([clip.name for clip, _ in clips])}, where {joint!r} keeps its place:"
                " a clip in place holds no motion of the root, which only a player adds, and a driver in the player"
                " follows"
            )
        return warnings

    def driven_as(self, tool: Flesh) -> SwingDrive:
        """The drive with the frequency, damping and gravity of another entry for the same region."""
        modes = tuple(
            replace(mode, spring=_spring(tool, faster))
            for mode, faster in zip(self.drive.modes, self.swings.speeds.tolist(), strict=True)
        )
        return replace(self.drive, modes=modes, gravity=self.down * tool.gravity)


def moves_of(weights: Floats) -> Floats:
    """(frames,) moves over the limit, from (frames, targets) weights."""
    return np.asarray(np.sqrt((signed(weights) ** 2).sum(axis=1)))


def attach_flesh(tools: Sequence[Flesh], ground: Ground, settings: ToolsFile) -> list[AttachedFlesh]:
    """Attach the regions of flesh of a mesh.

    Raises:
        WrinkleError: Regions do not fit, a line for each.
    """
    carriers: dict[int, Ground] = {}

    def attach(tool: Flesh) -> AttachedFlesh:
        if tool.carrier is None:
            return _attach(tool, ground, settings)
        own = (ground.document, tool.carrier, [tool], settings, ground.clips)
        carrier = once(carriers, tool.carrier, partial(read_ground, *own, neighbours=ground.neighbours))
        return _attach_over(tool, carrier, ground, settings)

    return BakeError.every(attach, tools)


def _attach(tool: Flesh, ground: Ground, settings: ToolsFile) -> AttachedFlesh:
    rest, rig = ground.rest, ground.rig
    named = _named_joint(tool, ground)
    place = _place(tool, ground, settings, _softness(tool, ground, named if tool.at is None else None))
    joint = _joint_at(ground, place) if named is None else named
    body = Body(rest.positions, rest.triangles, _bones(ground))
    try:
        swings = swings_of(body, place, tool.shapes)
    except NoFleshError:
        raise BakeError(
            f"holds no flesh: within {place.radius:.3g} of its middle, all of the body is at a bone or at the region's"
            " border; a larger radius, or a middle farther from bones, would help",
            where=tool.where,
        ) from None
    chosen = np.flatnonzero(_moving(ground, place))
    moved = swings.moves(rest.positions[chosen])
    follows = np.zeros(len(rest.positions))
    follows[chosen] = _fading(ground, ground.contacts.held, chosen, _SEAM * place.radius)
    moved *= follows[chosen, None]
    sizes = np.sqrt((moved**2).sum(axis=2)).max(axis=1, initial=0.0)
    if not sizes.max() > 0 or not (sizes > _LEAST_MOVE * sizes.max()).all():
        raise BakeError("holds no flesh under the skin of this mesh", where=tool.where)
    limit = tool.limit.resolve(place.radius)
    world = rest.matrices[joint] @ np.linalg.inv(rig.inverse_binds[joint])
    lengths = np.sqrt((world[:3, :3] ** 2).sum(axis=0))
    turn = world[:3, :3] / lengths
    down = turn.T @ np.array([0.0, -GRAVITY, 0.0])
    modes = tuple(
        Mode(_spring(tool, faster), turn.T @ load, float(size / limit))
        for faster, load, size in zip(swings.speeds.tolist(), swings.loads, sizes, strict=True)
    )
    drive = SwingDrive(
        name=tool.name,
        node=int(rig.joints[joint]),
        at=np.linalg.solve(world[:3, :3], place.at - world[:3, 3]),
        scale=float(np.cbrt(abs(determinants(world[None, :3, :3])[0]))),
        gravity=down * tool.gravity,
        modes=modes,
        targets=tool.target_names(len(modes) + 1),
    )
    factors = 2.0 * limit / sizes
    deltas = _deltas(rest, chosen, moved * factors[:, None, None])
    covers = _covers(ground, tool, place, chosen)
    return AttachedFlesh(tool, drive, deltas, limit, swings, place, factors, follows, covers, down)


def _spring(tool: Flesh, faster: float) -> Spring:
    """The spring of a shape that swings so many times as fast as the slowest one."""
    return Spring(2.0 * np.pi * tool.frequency * faster, tool.damping * faster)


def _attach_over(tool: Flesh, skin: Ground, ground: Ground, settings: ToolsFile) -> AttachedFlesh:
    """A mesh over a region: each vertex moves as the skin nearest to it does, with the same weights.

    What hangs farther from the skin than clothes lie follows less, and at last not at all. The same holds towards a
    border that the mesh shares with another one that stays.
    """
    region = _attach(tool, skin, settings)
    rest, place = ground.rest, region.place
    reach = _CLOSE * place.radius
    around = np.flatnonzero(((rest.positions - place.at) ** 2).sum(axis=1) < (place.radius + 2.0 * reach) ** 2)
    feet, shares, places = Tree.of(skin.rest.positions, skin.rest.triangles).closest_points(rest.positions[around])
    corners = skin.rest.triangles[feet]
    away = np.sqrt(((rest.positions[around] - places) ** 2).sum(axis=1))
    follows = (shares * region.follows[corners]).sum(axis=1)
    follows *= 1.0 - smoothstep(np.clip(away / reach - 1.0, 0.0, 1.0))
    names = (*tool.meshes, skin.rig.node_name)
    along = {node for node, name in enumerate(ground.rig.names) if name in names}
    contacts = contacts_of(ground.neighbours, ground.rig, ground.surface, rest.positions, along).held
    follows *= _fading(ground, contacts, around, _SEAM * place.radius)
    moved = region.swings.moves(places) * (region.factors[:, None] * follows)[:, :, None]
    deltas = _deltas(rest, around, moved)
    if not np.any(deltas, axis=(1, 2)).all():
        message = (
            f"{tool.node!r} does not lie over the region: none of it is within {2.0 * reach:.3g} of the skin there"
        )
        raise BakeError(message, where=tool.place("meshes"))
    return replace(region, deltas=deltas, covers=())


def _deltas(rest: Rest, chosen: Ints, moved: Floats) -> Floats:
    """(modes + 1, vertices, 3) bind space, from (modes, chosen, 3) moves in the world: the last undoes the others."""
    moved = np.concatenate([moved, -0.5 * moved.sum(axis=0, keepdims=True)])
    deltas = np.zeros((len(moved), *rest.positions.shape))
    deltas[:, chosen] = np.einsum("vab,mvb->mva", inverses(rest.blended[chosen]), moved)
    return deltas


def _place(tool: Flesh, ground: Ground, settings: ToolsFile, softness: Floats | None) -> Place:
    """The region of a tool: its ball, or one round all skin that its mask or its joint chooses."""
    rest = ground.rest
    if tool.at is None:
        assert softness is not None, "the schema asks for a middle without it"
        weights = softness / max(float(softness.sum()), TINY)
        middle = rest.foot(weights @ rest.positions)[0]
        away = np.sqrt(((rest.positions - middle) ** 2).sum(axis=1))
        # The whole of it, as the ball's border would hold it.
        return Place(middle, 2.0 * float(away[softness > 0].max(initial=0.0)), softness)
    (asked,) = asked_positions(ground.rig, rest, tool)
    radius = tool.radius
    assert radius is not None, "the schema asks for it"
    size = "radius", radius
    check_size(tool, size, rest, "half")
    foot = foot_of(tool, 0, asked, rest, size, settings.up)
    return Place(foot, radius, softness)


def _named_joint(tool: Flesh, ground: Ground) -> int | None:
    """The index of the joint that a region names; None if it names none."""
    if tool.joint is None:
        return None
    names = [ground.rig.names[node] for node in ground.rig.joints.tolist()]
    found = [number for number, name in enumerate(names) if name == tool.joint]
    if len(found) != 1:
        several = f"{len(found)} joints are" if found else "no joint of this mesh is"
        raise BakeError(unknown(f"{several} named", tool.joint, names), where=tool.place("joint"))
    return found[0]


def _joint_at(ground: Ground, place: Place) -> int:
    """The index of the joint of most weight at the middle of a region."""
    triangle, shares, _ = ground.rest.closest_point(place.at)
    weights = shares @ ground.surface.dense_weights(ground.surface.triangles[triangle], len(ground.rig.joints))
    return int(weights.argmax())


def _bones(ground: Ground) -> Floats:
    """(bones, 2, 3) ends of the bones: from each joint that skin follows to the next ones below it; world space."""
    rig, rest, surface = ground.rig, ground.rest, ground.surface
    if not rig.skinned:
        return np.zeros((0, 2, 3))
    followed = np.unique(surface.joints[surface.weights > 0])
    places = {
        int(rig.joints[number]): (rest.matrices[number] @ np.linalg.inv(rig.inverse_binds[number]))[:3, 3]
        for number in followed.tolist()
    }
    bones = [(place, place) for place in places.values()]
    for node, place in places.items():
        above = rig.next_above(node, places)
        if above >= 0:
            bones.append((places[above], place))
    return np.array(bones).reshape(-1, 2, 3)


def _moving(ground: Ground, place: Place) -> Bools:
    """(vertices,) True for the skin of a region, but not for a hand beside it.

    Skin belongs to the region if the mesh joins it to the middle within the region, or if it follows the same joints.
    """
    rest, surface = ground.rest, ground.surface
    near = ((rest.positions - place.at) ** 2).sum(axis=1) < place.radius**2
    edges, _ = numbered_edges(rest.triangles)
    labels = components(edges[near[edges].all(axis=1)], len(near))
    # Of large triangles, perhaps one corner alone lies within the region.
    triangle, _, _ = rest.closest_point(place.at)
    own = near & np.isin(labels, labels[rest.triangles[triangle]])
    weights = surface.dense_weights(np.flatnonzero(near), len(ground.rig.joints))
    joints = weights[own[near]].mean(axis=0) > _CARRIES if own.any() else np.zeros(len(weights.T), np.bool_)
    alike = np.bincount(labels[near], weights[:, joints].sum(axis=1), int(labels.max()) + 1)
    counts = np.bincount(labels[near], minlength=len(alike))
    return np.asarray(near & (own | (alike[labels] > _SAME_JOINTS * counts[labels])))


def _covers(ground: Ground, tool: Flesh, place: Place, chosen: Ints) -> tuple[str, ...]:
    """The names of other meshes that lie close over the (chosen,) skin of a region, as clothes do, and stay there."""
    positions = ground.rest.positions
    middle = chosen[((positions[chosen] - place.at) ** 2).sum(axis=1) < (_COVERED * place.radius) ** 2]
    reaches = np.zeros(len(positions))
    reaches[middle] = _CLOSE * place.radius
    return tuple(name for name in ground.meshes_over(reaches) if name not in tool.meshes)


def _fading(ground: Ground, contacts: Bools, chosen: Ints, width: float) -> Floats:
    """(chosen,) factors that fade towards the (vertices,) contacts at which another mesh touches this one."""
    held = np.flatnonzero(contacts & ~ground.surface.twins)
    if not len(held) or not len(chosen):
        return np.ones(len(chosen))
    distances, _ = nearest_of(ground.rest.positions[held], ground.rest.positions[chosen])
    return smoothstep(np.clip(distances / width, 0.0, 1.0))


def _softness(tool: Flesh, ground: Ground, joint: int | None) -> Floats | None:
    """(vertices,) factors from 0 to 1 of a region on the coarse skin; None if its ball alone says where it is.

    Args:
        tool: The region.
        ground: The mesh at rest.
        joint: The index of the joint whose skin is the region; None if the region is elsewhere.

    Raises:
        WrinkleError: The mask is missing or malformed.
    """
    surface = ground.surface
    soft = None
    if joint is not None:
        soft = surface.dense_weights(np.arange(len(surface.positions)), len(ground.rig.joints))[:, joint]
    mask = read_mask(tool, ground, np.arange(len(surface.triangles)))
    if mask is None:
        return soft
    painted = mask.welded(surface.weld, len(surface.positions))
    return painted if soft is None else painted * soft


def in_place(rig: Rig, clip: Clip) -> bool:
    """True if a body walks or runs in a clip, but keeps its place.

    The lowest joint is that of the foot which stands. Where the clip moves the body ahead, the foot keeps its place;
    in place, it slides backwards again and again. A leg that swings to and fro does not get anywhere.
    """
    count = int(np.clip(_SAMPLED * (clip.end - clip.start), 2, _MOST_SAMPLES)) + 1
    times = np.linspace(clip.start, clip.end, count)
    # A root joint may lie on the ground and stay there; toes, fingers and the like have no joint below them.
    ends = np.setdiff1d(rig.joints, rig.parents)
    rows = node_rows(rig, clip, times, ends.tolist())
    places = np.stack([np.broadcast_to(each[:, 3], (3, count)).T for each in rows])
    size = float(np.ptp(places[:, 0], axis=0).max())
    if not size > 0 or not clip.end > clip.start:
        return False
    lowest = (places[:, 1:, 1] + places[:, :-1, 1]).argmin(axis=0)
    steps = np.diff(places[:, :, [0, 2]], axis=1)
    run = float(np.linalg.norm(steps[lowest, np.arange(count - 1)].sum(axis=0)))
    way = float(np.ptp(places[:, :, [0, 2]].mean(axis=0), axis=0).max())
    return run > _RUNS * size * (clip.end - clip.start) and way < _SWAYS * run
