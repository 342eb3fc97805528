"""Regions of flesh suggested by the names of bones, where the skin is far enough from the bone.

They are guesses, firm and with a low limit, and the file says so. Rigs differ in where their bones begin, so places are
known by landmarks that all bodies have: hips, knees, neck and crown. From between two of them a ray goes to the skin,
and there is a region if its way is long enough for the body's size.
"""

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import forwards_of, read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.rays import distances_along
from wrinklecli.review.suggest.guesses import Guess, entries_of, rounded
from wrinklecli.review.suggest.text import Entry
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import Length

LEAST_VERTICES = 5
"""Least vertices that a region moves: one and the four around it on a grid. Fewer stand out as spikes as they swing."""

# Limit of a guessed region over its radius: two thirds of what a region gets by itself.
_LIMIT = 8.0
# Its frequency in hertz.
_FREQUENCY = 6.0


@dataclass(frozen=True, slots=True)
class _Spot:
    """A part of a body that swings. Lengths are ratios of the body's height.

    Attributes:
        between: The two landmarks between which its height lies,
        along: and the part of the way from the first one to the second.
            turn: The direction from there to the skin, degrees from forwards out to its own side.
        depth: Least distance from there to the skin.
        radius: The region's radius.
        over_legs: True if it lies above or below the joint of a leg, False if the ray leaves the middle of the body.
    """

    between: tuple[str, str]
    along: float
    turn: float
    depth: float
    radius: float
    over_legs: bool = True


# Heights are those of a human: over the whole, hip joints, knees and the lowest joint of the neck stand at 0.52, 0.28
# and 0.83, the navel at 0.6, nipples at 0.73, cheeks below the eyes at 0.9. Depths and radii were measured on humans of
# 1.75 m; lean ones have less than the least depth of a belly or a thigh.
_SPOTS: Mapping[str, _Spot] = {
    "belly": _Spot(("hips", "neck"), 0.25, 0, 0.055, 0.075, over_legs=False),
    "chest": _Spot(("hips", "neck"), 0.64, 0, 0.055, 0.045),
    "buttock": _Spot(("hips", "knees"), 0, 180, 0.05, 0.055),
    "thigh": _Spot(("hips", "knees"), 0.3, 217, 0.038, 0.05),
    "cheek": _Spot(("neck", "crown"), 0.4, 37, 0.035, 0.02, over_legs=False),
}


def suggest_flesh(
    document: Document, grounds: Sequence[Ground], nodes: Mapping[int, str | None], clips: Sequence[Clip], *, fps: float
) -> tuple[list[Entry], list[str], str]:
    """Suggest regions of flesh where the rig names bones, and the skin is thick.

    Args:
        document: The asset.
        grounds: Its meshes that deform.
        nodes: Their nodes, each with the name that a file must give; None if it need not.
        clips: Motions of the asset, which may be none.
        fps: Frames a second at which these are looked at.

    Returns:
        The regions, a line for each that fits no mesh, and why there are none.
    """
    frame = _Frame.of(document, grounds) if grounds else None
    if frame is None:
        return [], [], "no joints of a mesh are named as two legs, with a neck or a head above"
    low, high = (f([f(each.rest.positions, axis=0) for each in grounds], axis=0) for f in (np.min, np.max))
    size = float((high - low).max())
    # Meshes that deform, by names that no other node has.
    names = read_hierarchy(document).names
    counts = Counter(names)
    clothes = {names[node] for node in nodes if counts[names[node]] == 1}
    found: list[Guess] = []
    notes: list[str] = []
    for name, spot in _SPOTS.items():
        ways = {letter: _way(*ray, grounds) for letter, ray in frame.sides(spot).items()}
        thick = max((depth for depth, _, _ in ways.values() if depth < np.inf), default=0.0)
        if thick < spot.depth * size:
            notes.append(
                f"{name}: left out, as skin and bone are {thick:.3g} apart; less than {spot.depth * size:.3g} hardly"
                " swings"
            )
            continue
        regions = [
            _fitted(f"{name}.{letter}" if letter else name, spot, *way, size, nodes, clothes)
            for letter, way in ways.items()
        ]
        fitted = [each for each in regions if isinstance(each, Guess)]
        notes += [each for each in regions if isinstance(each, str)]
        if len(fitted) == len(regions):
            found += fitted
        else:
            # Flesh on one side alone looks like a fault.
            notes += [f"{each.effect.name}: left out, as the other side is" for each in fitted]
    why = "nowhere is the skin far enough from the bones, and its mesh fine enough"
    return entries_of(found, clips, fps=fps), notes, "" if found else why


@dataclass(frozen=True, slots=True)
class _Frame:
    """The frame of a body.

    Attributes:
        landmarks: By name, (2, 3) places of the left leg and of the right one, or as far to the side as these.
        forwards: (3,) unit, where the body looks.
        left: (3,) unit, to its left.
    """

    landmarks: Mapping[str, Floats]
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
        legs, knees = (each[np.argsort(-each @ left)] for each in (legs, knees))
        beside = ((legs - legs.mean(axis=0)) @ left)[:, None] * left
        top = (heads if len(heads) else necks)[0]
        crown = np.array([top[0], max(float(each.rest.positions[:, 1].max()) for each in grounds), top[2]])
        places = {"hips": legs, "knees": knees, "neck": necks[0] + beside, "crown": crown + beside}
        return cls(places, forwards, left)

    def sides(self, spot: _Spot) -> dict[str, tuple[Floats, Floats]]:
        """The start and the direction of a spot's ray by the letter of its side; an empty one in the middle."""
        places = np.stack([self.landmarks[name] for name in spot.between])
        starts = places[0] + spot.along * (places[1] - places[0])
        if not spot.over_legs:
            starts[:] = starts.mean(axis=0)
        ahead, outwards = np.cos(np.radians(spot.turn)), np.sin(np.radians(spot.turn))
        found = {}
        for letter, sign, start in (
            zip("LR", (1.0, -1.0), starts, strict=True) if spot.over_legs or spot.turn else [("", 0.0, starts[0])]
        ):
            way = ahead * self.forwards + sign * outwards * self.left
            found[letter] = start, unit(way)
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
) -> Guess | str:
    """A region where a ray meets the skin, with clothes over it by name, or the line that says why there is none."""
    if depth == np.inf:
        return f"{called}: left out, as there is no skin where it would be"
    region = Flesh(
        name=called,
        node=nodes[ground.rig.node],
        at=rounded(place, size),
        radius=float(f"{spot.radius * size:.3g}"),
        frequency=_FREQUENCY,
        limit=Length(_LIMIT, percent=True),
        where=ground.document.path,
    )
    try:
        # Three shapes tell how far it swings.
        attached = attach_one(replace(region, shapes=3), ground)
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
    return Guess(replace(region, meshes=worn), ground, attached, place[None], {"depth": depth})
