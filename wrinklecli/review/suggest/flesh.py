"""Regions of flesh suggested by the names of bones, where the skin is far enough from the bone.

They are guesses, firm and with a low limit, and the file says so. Rigs differ in where their bones begin, so places are
known by landmarks that all bodies have: hips, knees, neck and crown. From between two of them a ray goes to the skin,
and there is a region if its way is long enough for the body's size.
"""

import os
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import forwards_of, read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.rays import distances_along
from wrinklecli.review.suggest.moves import STILL, Move, greatest_moves, move_of
from wrinklecli.review.suggest.text import entry, quoted
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import Length, ToolsFile
from wrinklecli.tools.yaml_tree import printable

LEAST_VERTICES = 5
"""Least vertices that a region moves: one and the four around it on a grid. Fewer stand out as spikes as they swing."""

# Limit of a guessed region over its radius: two thirds of what a region gets by itself.
_LIMIT = 8.0
# Its frequency in hertz.
_FREQUENCY = 6.0
# Difference of both sides over the body's size below which a body is symmetric about x = 0.
_SYMMETRIC = 0.01
# Least way of a ray over the body's size: a bone that lies on the skin has no flesh.
_OWN = 1e-6


@dataclass(frozen=True, slots=True)
class _Spot:
    """A part of a body that swings. Lengths are ratios of the body's height.

    Attributes:
        between: The two landmarks between which its height lies,
        along: and the part of the way from the first one to the second.
        ray: The direction from there to the skin: forwards, and out to its own side.
        depth: Least distance from there to the skin.
        radius: The region's radius.
        paired: True if there is one on each side.
        over_legs: True if it lies above or below the joint of a leg, False if the ray leaves the middle of the body.
    """

    between: tuple[str, str]
    along: float
    ray: tuple[float, float]
    depth: float
    radius: float
    paired: bool = True
    over_legs: bool = True


# Heights are those of a human: over the whole, hip joints, knees and the lowest joint of the neck stand at 0.52, 0.28
# and 0.83, the navel at 0.6, nipples at 0.73, cheeks below the eyes at 0.9. Depths and radii were measured on humans of
# 1.75 m; lean ones have less than the least depth of a belly or a thigh.
_SPOTS: Mapping[str, _Spot] = {
    "belly": _Spot(("hips", "neck"), 0.25, (1, 0), 0.055, 0.075, paired=False, over_legs=False),
    "chest": _Spot(("hips", "neck"), 0.64, (1, 0), 0.055, 0.045),
    "buttock": _Spot(("hips", "knees"), 0, (-1, 0), 0.05, 0.055),
    "thigh": _Spot(("hips", "knees"), 0.3, (-0.8, -0.6), 0.038, 0.05),
    "cheek": _Spot(("neck", "crown"), 0.4, (0.8, 0.6), 0.035, 0.02, over_legs=False),
}


@dataclass(frozen=True, slots=True)
class SuggestedFlesh:
    """A region that is guessed.

    Attributes:
        region: The region; its side is the left one if `mirrored`.
        mirrored: True if the other side has the same.
        depth: Distance from the bone to the skin, scene units.
        move: What the clips do to it, or to its mirror image if they move that more.
    """

    region: Flesh
    mirrored: bool
    depth: float
    move: Move = STILL


def suggest_flesh(
    document: Document, nodes: Mapping[int, str | None], clips: tuple[Clip, ...], *, fps: float
) -> tuple[list[SuggestedFlesh], list[str], str]:
    """Suggest regions of flesh where the rig names bones, and the skin is thick.

    Args:
        document: The asset.
        nodes: Nodes whose meshes deform, each with the name that a file must give; None if it need not.
        clips: Motions of the asset, which may be none.
        fps: Frames a second at which these are looked at.

    Returns:
        The regions, a line for each that fits no mesh, and why there are none.
    """
    settings = ToolsFile(path=document.path)
    grounds = [read_ground(document, node, [], settings, clips) for node in nodes]
    if not grounds:
        return [], [], "no mesh deforms"
    frame = _Frame.of(document, grounds)
    if frame is None:
        return [], [], "no joints are named as two legs, with a neck or a head above"
    low, high = (f([f(each.rest.positions, axis=0) for each in grounds], axis=0) for f in (np.min, np.max))
    size = float((high - low).max())
    # Meshes that deform, by names that no other node has.
    names = read_hierarchy(document).names
    counts = Counter(names)
    clothes = {names[node] for node in nodes if counts[names[node]] == 1}
    found: list[SuggestedFlesh] = []
    notes: list[str] = []
    kept: list[tuple[Ground, AnyAttached]] = []
    for name, spot in _SPOTS.items():
        ways = {letter: _way(*ray, grounds) for letter, ray in frame.sides(spot).items()}
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
        fitted = [each[0] for each in regions if not isinstance(each, str)]
        notes += [each for each in regions if isinstance(each, str)]
        if len(fitted) < len(regions) == 2:
            # Flesh on one side alone looks like a fault.
            notes += [f"{each.region.name}: left out, as the other side is" for each in fitted]
            continue
        kept += [
            (way[2], each[1]) for way, each in zip(ways.values(), regions, strict=True) if not isinstance(each, str)
        ]
        if len(fitted) == 2 and _mirrored(fitted[0], fitted[1], size):
            found.append(replace(fitted[0], mirrored=True))
        else:
            found += fitted
    moves = greatest_moves(kept, clips, fps=fps)
    found = [replace(each, move=move_of(each.region.name, moves, mirrored=each.mirrored)) for each in found]
    return found, notes, "" if found else "nowhere is the skin far enough from the bones, and its mesh fine enough"


@dataclass(frozen=True, slots=True)
class _Frame:
    """The frame of a body.

    Attributes:
        landmarks: By name, (3,) places in the middle of the body.
        hips: (2, 3) from the middle of the hips to the joint of the left leg and to that of the right one.
        forwards: (3,) unit, where the body looks.
        left: (3,) unit, to its left.
    """

    landmarks: Mapping[str, Floats]
    hips: Floats
    forwards: Floats
    left: Floats

    @classmethod
    def of(cls, document: Document, grounds: Sequence[Ground]) -> "_Frame | None":
        """Find the landmarks of a body; None if its rig does not name legs, and a neck or a head."""
        hierarchy, bones = read_hierarchy(document), read_bones(document)

        def first(*parts: Part) -> Floats:
            """(joints, 3) places of the joints of parts that have none of them above."""
            own = [k for k, part in enumerate(bones.parts) if part in parts]
            tops = [k for k in own if hierarchy.parents[k] < 0 or bones.parts[hierarchy.parents[k]] not in parts]
            return stored_positions(hierarchy, tops)

        legs, knees, necks, heads = first("upper leg"), first("lower leg"), first("neck", "head"), first("head")
        if len(legs) != 2 or len(knees) != 2 or not len(necks):
            return None
        forwards = forwards_of(hierarchy, bones)
        left = np.cross([0.0, 1.0, 0.0], forwards)
        legs = legs[np.argsort(-legs @ left)]
        hips, top = legs.mean(axis=0), (heads if len(heads) else necks)[0]
        crown = max(float(each.rest.positions[:, 1].max()) for each in grounds)
        middles = {"hips": hips, "knees": knees.mean(axis=0), "neck": necks[0]}
        return cls({**middles, "crown": np.array([top[0], crown, top[2]])}, legs - hips, forwards, left)

    def sides(self, spot: _Spot) -> dict[str, tuple[Floats, Floats]]:
        """The start and the direction of a spot's ray by the letter of its side; an empty one in the middle."""
        start, end = (self.landmarks[name] for name in spot.between)
        ahead, outwards = spot.ray
        found = {}
        for letter, sign, leg in zip("LR", (1.0, -1.0), self.hips, strict=True) if spot.paired else [("", 0.0, None)]:
            beside = 0.0 if leg is None or not spot.over_legs else (leg @ self.left) * self.left
            way = ahead * self.forwards + sign * outwards * self.left
            found[letter] = start + spot.along * (end - start) + beside, unit(way)
        return found


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
) -> tuple[SuggestedFlesh, AnyAttached] | str:
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
        frequency=_FREQUENCY,
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
    worn = () if "crown" in spot.between else tuple(each for each in attached.covers if each in clothes)
    return SuggestedFlesh(replace(region, meshes=worn), False, depth), attached


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
        "# names of bones and the thickness of the body. Look at each in a preview, make it softer (a lower",
        "# frequency), let it swing further (a higher limit), or delete it.",
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
        lines += [f"  # {each.move.moment}: moves by {each.move.height:.2g}"] if each.move.clip else []
        lines += entry(region.name, keys)
    return "\n".join(lines) + "\n"
