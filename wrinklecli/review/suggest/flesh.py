"""Regions of flesh suggested by the names of bones, where the skin is far enough from the bone.

They are guesses, firm and with a low limit, and the file says so. Each place is where a ray from a bone meets the skin;
there is a region if the way is long enough for the body's size.
"""

import os
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import Bones, read_bones
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import Hierarchy, read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.rays import distances_along
from wrinklecli.review.suggest.anatomy import forwards_of
from wrinklecli.review.suggest.text import entry, quoted
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import Length, ToolsFile
from wrinklecli.tools.yaml_tree import printable

LEAST_VERTICES = 5
"""Least vertices that a region moves: one and the four around it on a grid. Fewer stand out as spikes as they swing."""

# Limit of a guessed region over its radius: two thirds of what a region gets by itself.
_LIMIT = 8.0
# Difference of both sides over the body's size below which a body is symmetric about x = 0.
_SYMMETRIC = 0.01
# Least way of a ray over the body's size: a bone that lies on the skin has no flesh.
_OWN = 1e-6


@dataclass(frozen=True, slots=True)
class _Spot:
    """A part of a body that swings. Lengths are ratios of the body's height.

    Attributes:
        part: The bone from which a ray goes to the skin.
        along: The place on the bone, over the way to the next bone below; a bone without one counts as a point.
        rises: Height of that place above the bone's joint, besides.
        ray: Its direction: forwards, to the side of the body (left for regions of both sides), and up.
        depth: Least distance from the bone to the skin.
        radius: The region's radius.
        frequency: In hertz.
        paired: True if there is one on each side.
        beside: Distance of the ray's start from the bone to the side.
    """

    part: Part
    along: float
    rises: float
    ray: tuple[float, float, float]
    depth: float
    radius: float
    frequency: float
    paired: bool
    beside: float = 0.0


# Depths and radii were measured on humans of 1.75 m; lean ones have less than the least depth of a belly or a thigh.
_SPOTS: Mapping[str, _Spot] = {
    "belly": _Spot("spine", 0.0, -0.02, (1.0, 0.0, -0.1), 0.055, 0.075, 5.0, False),
    "chest": _Spot("chest", 0.0, 0.02, (1.0, 0.2, 0.0), 0.055, 0.045, 6.0, True, 0.045),
    "buttock": _Spot("upper leg", 0.0, 0.0, (-1.0, 0.0, 0.0), 0.05, 0.055, 6.0, True),
    "thigh": _Spot("upper leg", 0.35, 0.0, (-0.8, -0.6, 0.0), 0.038, 0.05, 6.0, True),
    "cheek": _Spot("head", 0.0, 0.02, (0.8, 0.6, 0.0), 0.035, 0.02, 8.0, True),
}


@dataclass(frozen=True, slots=True)
class SuggestedFlesh:
    """A region that is guessed.

    Attributes:
        region: The region; its side is the left one if `mirrored`.
        mirrored: True if the other side has the same.
        depth: Distance from the bone to the skin, scene units.
    """

    region: Flesh
    mirrored: bool
    depth: float


def suggest_flesh(document: Document, nodes: Mapping[int, str | None]) -> tuple[list[SuggestedFlesh], list[str], str]:
    """Suggest regions of flesh where the rig names bones, and the skin is thick.

    Args:
        document: The asset.
        nodes: Nodes whose meshes deform, each with the name that a file must give; None if it need not.

    Returns:
        The regions, a line for each that fits no mesh, and why there are none.
    """
    hierarchy, bones = read_hierarchy(document), read_bones(document)
    joints = {part: [k for k, each in enumerate(bones.parts) if each == part] for part in bones.parts}
    if not any(joints.get(spot.part) for spot in _SPOTS.values()):
        return [], [], "no joints are named as a spine, a chest, a head or upper legs"
    settings, clips = ToolsFile(path=document.path), read_clips(document)
    grounds = [read_ground(document, node, [], settings, clips) for node in nodes]
    if not grounds:
        return [], [], "no mesh deforms"
    low, high = (f([f(each.rest.positions, axis=0) for each in grounds], axis=0) for f in (np.min, np.max))
    size = float((high - low).max())
    # Meshes that deform, by names that no other node has.
    counts = Counter(hierarchy.names)
    clothes = {hierarchy.names[node] for node in nodes if counts[hierarchy.names[node]] == 1}
    found: list[SuggestedFlesh] = []
    notes: list[str] = []
    for name, spot in _SPOTS.items():
        ways = {letter: _way(*ray, grounds) for letter, ray in _sides(spot, hierarchy, bones, size).items()}
        thick = max((depth for depth, _, _ in ways.values() if depth < np.inf), default=0.0)
        if ways and thick < spot.depth * size:
            notes.append(
                f"{name}: left out, as skin and bone are {thick:.3g} apart; less than {spot.depth * size:.3g} hardly"
                " swings"
            )
            continue
        regions = [
            _fitted(f"{name}.{letter}" if letter else name, spot, *way, size, nodes, clothes)
            for letter, way in ways.items()
        ]
        fitted = [each for each in regions if isinstance(each, SuggestedFlesh)]
        notes += [each for each in regions if isinstance(each, str)]
        if len(fitted) < len(regions) == 2:
            # Flesh on one side alone looks like a fault.
            notes += [f"{each.region.name}: left out, as the other side is" for each in fitted]
            continue
        if len(fitted) == 2 and _mirrored(fitted[0], fitted[1], size):
            found.append(SuggestedFlesh(fitted[0].region, True, fitted[0].depth))
        else:
            found += fitted
    return found, notes, "" if found else "nowhere is the skin far enough from the bones, and its mesh fine enough"


def _sides(spot: _Spot, hierarchy: Hierarchy, bones: Bones, size: float) -> dict[str, tuple[Floats, Floats]]:
    """The start and the direction of the ray for each side, by its letter; an empty one for a region in the middle."""
    joints = [k for k, each in enumerate(bones.parts) if each == spot.part]
    # Of a chain, such as a spine, the first bone counts.
    joints = [k for k in joints if not _below(hierarchy, k, joints)]
    if not joints:
        return {}
    forwards = forwards_of(hierarchy, bones)
    aside = np.cross([0.0, 1.0, 0.0], forwards)
    middle = stored_positions(hierarchy, joints).mean(axis=0)
    ahead, sideways, up = spot.ray
    found = {}
    for letter, sign in (("L", 1.0), ("R", -1.0)) if spot.paired else (("", 0.0),):
        places = stored_positions(hierarchy, joints)
        own = [
            k
            for k, place in zip(joints, places, strict=True)
            if len(joints) == 1 or sign * (place - middle) @ aside > 0
        ]
        if not own:
            continue
        start = stored_positions(hierarchy, own)[0]
        below = [k for k, parent in enumerate(hierarchy.parents) if parent == own[0] and bones.parts[k] is not None]
        if below and spot.along:
            start = start + spot.along * (stored_positions(hierarchy, below)[0] - start)
        start = start + size * (spot.rises * np.array([0.0, 1.0, 0.0]) + sign * spot.beside * aside)
        found[letter] = start, unit(ahead * forwards + sign * sideways * aside + np.array([0.0, up, 0.0]))
    return found


def _below(hierarchy: Hierarchy, node: int, others: Sequence[int]) -> bool:
    """True if a node is below one of others."""
    node = int(hierarchy.parents[node])
    while node >= 0:
        if node in others:
            return True
        node = int(hierarchy.parents[node])
    return False


def _way(start: Floats, ray: Floats, grounds: Sequence[Ground]) -> tuple[float, Floats, Ground]:
    """The way of a ray from a bone to the first skin, infinite if it meets none; the place, and its mesh."""
    ways = [
        float(distances_along(start, ray, each.rest.positions[each.rest.triangles]).min(initial=np.inf))
        for each in grounds
    ]
    nearest = int(np.argmin(ways))
    depth = ways[nearest]
    return depth, start + depth * ray if depth < np.inf else start, grounds[nearest]


def _fitted(
    called: str,
    spot: _Spot,
    depth: float,
    place: Floats,
    ground: Ground,
    size: float,
    nodes: Mapping[int, str | None],
    clothes: Container[str],
) -> SuggestedFlesh | str:
    """A region where a ray meets the skin, with clothes over it by name, or the line that says why there is none."""
    if not _OWN * size < depth < np.inf:
        return f"{called}: left out, as there is no skin where it would be"
    digits = 4 - int(np.floor(np.log10(size)))
    x, y, z = (round(float(each), digits) + 0.0 for each in place)
    region = Flesh(
        name=called,
        node=nodes[ground.rig.node],
        at=(x, y, z),
        radius=float(f"{spot.radius * size:.3g}"),
        frequency=spot.frequency,
        limit=Length(_LIMIT, percent=True),
        shapes=3,
        where=ground.document.path,
    )
    try:
        attached = attach_one(region, ground)
    except WrinkleError as error:
        return f"{called}: left out: {error.lines[0].removeprefix(f'{ground.document.path}: ')}"
    moved = 0 if attached.moves is None else int(np.any(attached.moves.deltas, axis=(0, 2)).sum())
    if moved < LEAST_VERTICES:
        return (
            f"{called}: left out, as the mesh is too coarse there: {counted(moved, 'vertex', 'vertices')} would move,"
            f" fewer than {LEAST_VERTICES}"
        )
    # What lies over a face, such as glasses or hair, does not move with it.
    worn = () if spot.part == "head" else tuple(each for each in attached.covers if each in clothes)
    return SuggestedFlesh(replace(region, meshes=worn), False, depth)


def _mirrored(left: SuggestedFlesh, right: SuggestedFlesh, size: float) -> bool:
    """True if two regions are mirror images about x = 0."""
    places = [each.region.at for each in (left, right)]
    apart = np.abs(np.array(places[0]) * [-1.0, 1.0, 1.0] - np.array(places[1])).max()
    alike = left.region.node == right.region.node and left.region.meshes == right.region.meshes
    return bool(apart < _SYMMETRIC * size) and alike


def flesh_text(regions: Sequence[SuggestedFlesh], document: Document) -> str:
    """A tools file of suggested regions, which says that they are guesses."""
    lines = [
        f"# Flesh for {printable(os.path.basename(document.path), 90)}, as `wrinkle suggest --flesh` guesses it by the",
        "# names of bones and the thickness of the body. Nothing has been measured in motion: look at each in a",
        "# preview, make it softer (a lower frequency), let it swing further (a higher limit), or delete it.",
        "version: 1",
        "",
        "flesh:",
    ]
    for each in regions:
        region = each.region
        assert isinstance(region.at, tuple)
        keys = {
            "node": None if region.node is None else quoted(region.node),
            "at": f"[{', '.join(f'{x:.12g}' for x in region.at)}]",
            "radius": f"{region.radius:.12g}   # a guess: skin and bone are {each.depth:.3g} apart",
            "mirror": "x" if each.mirrored else None,
            "frequency": f"{region.frequency:.12g}",
            "limit": f"{_LIMIT:.12g}%",
            "meshes": f"[{', '.join(map(quoted, region.meshes))}]   # over it" if region.meshes else None,
        }
        lines += entry(region.name, keys)
    return "\n".join(lines) + "\n"
