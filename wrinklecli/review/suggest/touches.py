"""Touches suggested where a clip brings a fingertip to skin that is not of its own arm.

Fingers are known by the names of joints. A tip is as wide as the skin round it, and where it comes nearest to other
skin decides which side of it touches. The tip, its place and its slide are measured in the clip; the reach and the grip
are guesses, and the file says so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrinklecli.baking.job import BakeOptions, job_of
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.bones import Bones, read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.moved import Motions
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Hierarchy, read_hierarchy
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.choices import MAX_LEVELS, Part
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.closest import closest_point
from wrinklecli.review.suggest.guesses import rounded
from wrinklecli.review.suggest.measure import MOST_POSES
from wrinklecli.review.suggest.text import Entry
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Touch, TouchWrinkles
from wrinklecli.tools.mirror import numbered
from wrinklecli.tools.records import JointPoint, Length, RefinementSettings, ToolsFile, identifier
from wrinklecli.tools.yaml_tree import printable

# A tip touches where its middle is at most so many of its radii from other skin: animators leave a gap.
_TOUCHES = 1.3
# Part of a last bone's length, from its end, round which a tip's radius is measured.
_END = 0.5
# Parts of an arm, the innermost first: what lies below the first that there is cannot be reached by its own fingers.
_ARM: tuple[Part, ...] = ("upper arm", "lower arm", "hand", "finger")
# `press` over the gap that the clip leaves, so that the tip touches for certain; and what a file gets by itself.
_PRESSED, _LEAST_PRESS = 1.3, 0.2
# `grip` over the one at which the skin would look folded.
_SAFE = 0.95
# Reach over the pad, per cent, and rings: fewer and wider ones than a file gets by itself, as a fingertip is small
# beside the triangles of most bodies.
_REACH, _BUMPS = 150.0, 4
# Of the distances of a tip's skin from its axis, the part that is at most the radius: the end is round.
_ROUND = 0.75
# What to do where nothing is found.
_BY_HAND = "a touch may name any node in `by`, or key its slide in `keys`, and `wrinkle edit` draws one with two clicks"


class _Tip(NamedTuple):
    """The end of a finger.

    Attributes:
        node: Its joint.
        arm: Nodes of its arm, whose skin it cannot touch.
        middle: (3,) the middle of its round end: world space at rest.
        radius: Of this end.
    """

    node: int
    arm: frozenset[int]
    middle: Floats
    radius: float


class _Skin(NamedTuple):
    """A mesh that may be touched, and the node that moves each of its vertices most."""

    ground: Ground
    mesh: SkinnedMesh
    movers: Ints

    @classmethod
    def of(cls, ground: Ground) -> "_Skin":
        """Look up the weights."""
        mesh = ground.surface.skinned(ground.rig)
        return cls(ground, mesh, ground.rig.joints[mesh.influences.heaviest])


class _Near(NamedTuple):
    """A tip near skin, at seconds of a clip: the mesh, a triangle and (3,) barycentric coordinates, and the distance.

    Attributes:
        distance: From the tip's middle to the skin.
        way: (3,) unit direction there, world space.
    """

    time: float
    skin: _Skin
    triangle: int
    shares: Floats
    distance: float
    way: Floats

    @property
    def place(self) -> Floats:
        """(3,) the place at rest, world space."""
        ground = self.skin.ground
        return np.asarray(self.shares @ ground.rest.positions[ground.surface.triangles[self.triangle]])


class _Contact(NamedTuple):
    """A tip at skin in a clip: when it comes, and when it is nearest."""

    clip: Clip
    first: _Near
    nearest: _Near


def suggest_touches(
    document: Document, grounds: Sequence[Ground], nodes: Mapping[int, str | None], clips: Sequence[Clip], *, fps: float
) -> tuple[list[Entry], list[str], str]:
    """Suggest touches where clips bring fingertips to skin.

    Args:
        document: The asset.
        grounds: Its meshes that deform.
        nodes: Their nodes, each with the name that a file must give; None if it need not.
        clips: The clips to look at.
        fps: Poses per second; at most 200 of a clip.

    Returns:
        The touches, those that slide farthest first, a line for each that does not fit, and why there are none.
    """
    hierarchy, bones = read_hierarchy(document), read_bones(document)
    if not clips:
        return [], [], f"it has no clip in which a fingertip could come near; {_BY_HAND}"
    skins = [_Skin.of(ground) for ground in grounds]
    tips = _tips(hierarchy, bones, skins)
    if not tips:
        return [], [], f"no joints are named as fingers, with skin round their ends; {_BY_HAND}"
    found: dict[str, Entry] = {}
    notes: list[str] = []
    contacts = [_contacts(tips, skins, clip, fps) for clip in clips]
    for tip, in_clips in zip(tips, zip(*contacts, strict=True), strict=True):
        own: list[Touch] = []
        for contact in (each for in_clip in in_clips for each in in_clip):
            place = contact.first.place
            # A touch of the same tip has the place already.
            if any(float(np.linalg.norm(place - np.array(each.at))) < 2.0 * each.pad for each in own):
                continue
            corners = contact.first.skin.ground.surface.triangles[contact.first.triangle]
            joint = int(contact.first.skin.movers[corners[int(contact.first.shares.argmax())]])
            name = f"touch {hierarchy.names[joint]}"
            name = numbered(name, found) if identifier(name) in found else name
            made = _fitted(name, tip, contact, hierarchy, nodes)
            if isinstance(made, str):
                notes.append(made)
            else:
                own.append(made.effect)
                found[identifier(name)] = made
    chosen = sorted(found.values(), key=lambda each: -float(each.facts["slide"]))
    reason = "" if chosen else f"in no clip does a fingertip come to the skin of another limb; {_BY_HAND}"
    return chosen, list(dict.fromkeys(notes)), reason


def _tips(hierarchy: Hierarchy, bones: Bones, skins: Sequence[_Skin]) -> list[_Tip]:
    """The ends of fingers with skin round them. A node below a finger's joints may mark its end."""
    joints = {int(node) for skin in skins for node in skin.ground.rig.joints}
    named = [k for k, part in enumerate(bones.parts) if part == "finger"]
    fingers = [k for k in named if k in joints or int(hierarchy.parents[k]) in joints]
    found = []
    for node in sorted(set(fingers).difference(hierarchy.parents[fingers].tolist())):
        line, parent = [*hierarchy.upwards(node)], int(hierarchy.parents[node])
        # The innermost bone of the arm.
        tops = (each for part in _ARM for each in line[::-1] if bones.parts[each] == part)
        top = next(tops, node)
        arm = frozenset(k for k in range(len(hierarchy.parents)) if top in hierarchy.upwards(k))
        # A joint at the very end of a finger moves no skin.
        ends = [node, parent] if parent in fingers else [node]
        made = next((tip for end in ends if (tip := _tip(node, end, arm, hierarchy, skins))), None)
        found += [] if made is None else [made]
    return found


def _tip(node: int, end: int, arm: frozenset[int], hierarchy: Hierarchy, skins: Sequence[_Skin]) -> _Tip | None:
    """The round end of the skin of a bone, carried by a node; None if the bone has no skin."""
    moved = [each.ground.rest.positions[each.movers == end] for each in skins]
    places = np.concatenate(moved) if moved else np.zeros((0, 3))
    if len(places) < 4:
        return None
    joint = node_matrices(hierarchy, None, np.zeros(1), [end])[0, 0, :3, 3]
    parent = int(hierarchy.parents[end])
    above = joint if parent < 0 else node_matrices(hierarchy, None, np.zeros(1), [parent])[0, 0, :3, 3]
    # A bone without one above it points to where its skin is.
    way = joint - above if np.linalg.norm(joint - above) > 0 and parent in arm else places.mean(axis=0) - joint
    if not way.any():
        return None
    way = unit(way)
    along = (places - joint) @ way
    last = along > along.max() - _END * np.ptp(along)
    middle = joint + np.median((places - joint - along[:, None] * way)[last], axis=0)
    away = places - middle - ((places - middle) @ way)[:, None] * way
    radius = float(np.quantile(np.linalg.norm(away, axis=1)[last], _ROUND))
    return _Tip(node, arm, middle + (along.max() - radius) * way, radius) if radius > 0 else None


def _contacts(tips: Sequence[_Tip], skins: Sequence[_Skin], clip: Clip, fps: float) -> list[list[_Contact]]:
    """Find for each tip where and when it comes to other skin in a clip, of which each pose is computed once."""
    count = int(np.clip(np.ceil((clip.end - clip.start) * fps), 1, MOST_POSES))
    times = np.linspace(clip.start, clip.end, count + 1)
    rig, nodes = skins[0].ground.rig, [tip.node for tip in tips]
    rests, moved = node_matrices(rig, None, np.zeros(1), nodes)[0], node_matrices(rig, clip, times, nodes)
    middles = [_carried(rests[k], moved[:, k], tip.middle) for k, tip in enumerate(tips)]
    # Triangles no corner of which is of the tip's arm.
    corners = [each.movers[each.ground.surface.triangles] for each in skins]
    others = [[np.flatnonzero(~np.isin(each, list(tip.arm)).any(axis=1)) for each in corners] for tip in tips]
    held: list[list[_Near]] = [[] for _ in tips]
    found: list[list[_Contact]] = [[] for _ in tips]
    for row, time in enumerate(times.tolist()):
        posed = [each.mesh.positions_at(clip, time) for each in skins]
        for k, tip in enumerate(tips):
            near = _nearest(time, skins, posed, others[k], middles[k][row])
            touches = near is not None and near.distance <= _TOUCHES * tip.radius
            held[k] += [near] if near is not None and touches else []
            if held[k] and (not touches or time == times[-1]):
                found[k].append(_Contact(clip, held[k][0], min(held[k], key=lambda each: each.distance)))
                held[k] = []
    return found


def _carried(before: Floats, after: Floats, point: Floats) -> Floats:
    """(…, 3) a world-space point that a node carries from one (4, 4) matrix to (…, 4, 4) others."""
    # A node that a scale of 0 hides has no inverse.
    carried: Floats = (after @ (np.linalg.pinv(before) @ np.append(point, 1.0)))[..., :3]
    return carried


def _nearest(
    time: float, skins: Sequence[_Skin], posed: Sequence[Floats], others: Sequence[Ints], middle: Floats
) -> _Near | None:
    """The skin that is nearest to a tip's middle at a time; None without any.

    The meshes have (vertices, 3) `posed` positions, and `others` are their (triangles,) that count.
    """
    found = []
    for skin, positions, triangles in zip(skins, posed, others, strict=True):
        if len(triangles):
            number, shares, place = closest_point(positions, skin.ground.surface.triangles[triangles], middle)
            way = place - middle
            found.append(_Near(time, skin, int(triangles[number]), shares, float(np.linalg.norm(way)), unit(way)))
    return min(found, key=lambda each: each.distance, default=None)


def _fitted(
    name: str, tip: _Tip, contact: _Contact, hierarchy: Hierarchy, nodes: Mapping[int, str | None]
) -> Entry | str:
    """The touch of a contact, or the line that says why it does not fit."""
    first, nearest, ground = contact.first, contact.nearest, contact.first.skin.ground
    size = float(np.ptp(ground.rest.positions, axis=0).max())
    before, then = (
        node_matrices(ground.rig, clip, np.array([time]), [tip.node])[0, 0]
        for clip, time in ((None, 0.0), (contact.clip, nearest.time))
    )
    # The side of the tip that is nearest to the skin then, carried back to rest.
    middle = _carried(before, then, tip.middle)
    at_rest = _carried(then, before, middle + tip.radius * nearest.way)
    offset = rounded(at_rest - before[:3, 3], size)
    press = max(_LEAST_PRESS, _PRESSED * (nearest.distance / tip.radius - 1.0))
    touch = Touch(
        name=name,
        node=nodes[ground.rig.node],
        at=rounded(first.place, size),
        pad=float(f"{tip.radius:.3g}"),
        reach=Length(_REACH, percent=True),
        wrinkles=TouchWrinkles(bumps=_BUMPS),
        press=Length(float(f"{100.0 * press:.3g}"), percent=True),
        by=JointPoint(hierarchy.names[tip.node], offset),
        where=ground.document.path,
    )
    left_out = f"{hierarchy.names[tip.node]} in {contact.clip.name} at {first.time:.2f} s: left out: "
    try:
        drag = attach_one(touch, ground).drag
        assert drag is not None, "a tip drags the skin of a touch"
        if drag.folding < drag.drive.grip:
            grip = _SAFE * 100.0 * drag.folding / tip.radius
            touch = replace(touch, grip=Length(float(f"{grip:.3g}"), percent=True))
            drag = attach_one(touch, ground).drag
            assert drag is not None, "a tip drags the skin of a touch"
    except WrinkleError as error:
        return left_out + error.lines[0].removeprefix(f"{ground.document.path}: ")
    if contact.clip.name not in drag.drive.ends:
        return left_out + "it comes from the side, and stays above the skin"
    # The greatest slide in the clip, scene units.
    slide = max(np.hypot(*rows[:, 1:3].T).max() for rows in drag.drive.strokes_in(ground.rig.own, contact.clip))
    does = f"slides the skin by {slide:.3g}" if slide else "presses it"
    when = f"in clip {printable(contact.clip.name, 90)} at {first.time:.2f} s"
    assert touch.by is not None
    facts = {"tip": touch.by.joint, "clip": contact.clip.name, "time": first.time, "slide": float(slide)}
    return Entry(touch, remarks=[f"{printable(touch.by.joint, 90)} comes {when}, and {does}"], facts=facts)


def refinement_for(touches: Sequence[Entry], document: Document) -> RefinementSettings:
    """The least levels of refinement with which rings have vertices enough."""
    usual = RefinementSettings()
    own = tuple(each.effect for each in touches)
    settings = ToolsFile(path=document.path, effects=own, refinement=replace(usual, max_levels=MAX_LEVELS))
    plans = plan_meshes(job_of(document, settings, BakeOptions(), Motions(range_of_motion=False)))
    levels = max(plan.fine.subdivision.levels for plan in plans)
    return replace(usual, max_levels=max(levels, usual.max_levels))
