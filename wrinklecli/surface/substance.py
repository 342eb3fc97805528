"""The substance of a place: skin, cloth, leather, or hard parts that do not wrinkle, with its confidence.

Metal, plates and boxes are hard. Else evidence is added up as logarithms of odds: the colours of the place say most,
then the words of names, then the part of the body. A place about which the file says nothing counts as skin, whose
wrinkles are the lowest, with low confidence. All of a piece of a surface, such as a sleeve, is of one substance.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from wrinklecli.character.bones import words_of
from wrinklecli.character.rig import Rig
from wrinklecli.choices import SUBSTANCES, MaterialName, Part
from wrinklecli.choices import Substance as SubstanceKind
from wrinklecli.errors import AssetError, shortened
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import (
    TINY,
    Bools,
    Floats,
    Ints,
    among,
    distinct,
    distinct_values,
    face_normals,
    groups_of,
    ramp,
    unit,
)
from wrinklecli.numeric.memory import once
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.pieces import difference, pieces_of
from wrinklecli.surface.strain import Gauge, read_gauge
from wrinklecli.surface.swatch import SAMPLED, Pictures, Swatches
from wrinklecli.tools.records import ToolsFile

# The reason of a substance that the user gives.
BY_USER = "as --material says"
# The reason of a substance of which no colour and no name says anything.
_UNTOLD = "as nothing says what it is made of"

# Words of names, singular; the first kind wins. No fold crosses hair, eyes and teeth, and none is in a full bag. Some
# words are those of Ready Player Me (`Wolf3D_Outfit_Footwear`), Daz (`EyeMoisture`, `Fingernails`) and Character
# Creator (`Std_Eye_Occlusion`).
WORDS: dict[SubstanceKind, str] = {
    "leather": "leather boot shoe sneaker footwear sandal glove saddle",
    "hard": """metal metallic steel iron chrome gold silver brass copper alloy armor armour robot bot mech machine
        plastic glass glasses eyewear goggle stone wood wooden plate screw bolt gear helmet headwear visor lens gun
        weapon sword shield buckle button zipper rubber wheel jewelry earring necklace hair eyebrow brow beard lash
        eyelash eye iris irises cornea pupil sclera tearline eyemoisture tooth teeth tongue gum nail fingernail toenail
        horn claw hoof fur furry pelt feather plumage belt strap holster pouch bag backpack rucksack""",
    "cloth": """cloth clothes clothing shirt tshirt trouser pant jeans denim jacket coat cape cloak robe dress skirt
        sleeve fabric cotton wool silk linen sock stocking legging tights scarf hood hoodie sweater suit bodysuit short
        tunic uniform top bottom onepiece kimono apron vest underwear bra panties blouse garment outfit textile hat cap
        tie""",
    "skin": "skin flesh dermis",
}
_KIND_OF: dict[str, SubstanceKind] = {word: kind for kind, words in reversed(WORDS.items()) for word in words.split()}
# Words for fur, which hides the folds of the skin below it; and animals that have it, if their rigs are animals'.
_FUR = "fur furry pelt feather plumage"
_FURRED = """fox wolf dog puppy hound cat kitten bear tiger lion leopard panther cheetah lynx rabbit hare squirrel
    raccoon badger otter beaver mouse rat hamster sheep lamb goat alpaca monkey ape gorilla panda koala kangaroo"""
# Japanese words, which have no spaces between them, of MikuMikuDance and VRM models.
_JAPANESE: dict[SubstanceKind, str] = {
    "leather": "革|靴(?!下)|ブーツ|ベルト|手袋",
    "hard": "金属|金具|鎧|眼鏡|メガネ|ボタン|髪|目|瞳|眉|睫|まつげ|歯|舌|爪|角",
    "cloth": "服|布|袖|襟|シャツ|ズボン|パンツ|スカート|上着|コート|マント|帽子|靴下|リボン|ネクタイ|タイツ|着",
    "skin": "肌|皮膚",
}
# Words of joints that people lack, and of one that animals lack: a cat girl and an angel have it, too.
_BEASTLY = re.compile(r"\b(tail|wing|paw|hoof|(front|hind) ?(thigh|leg|foot|paw)|fore ?leg)\b|尾|翼")
_HUMAN = re.compile(r"thumb|親指")
# Least metallic factor of a metal. Dirty metal, and cloth woven with wire, have less, and all materials that Blender
# reads from FBX have what FBX calls reflection: 0.4 or 0.5.
_METALLIC = 0.75
# Least weight of a joint that a vertex follows alone.
_RIGID_WEIGHT = 0.98
# Part of a region's corners that follow one joint each in a rigid region.
_RIGID_PART = 0.9
# Least part of a rigid region that follows a second joint: else all of it moves as one, as a face moves with its head.
_SECOND_JOINT = 0.05
# Length of the mean unit normal of a point on an edge of a box: faces at 90° have 0.71, the faces of a hexagon 0.87.
_BOX_NORMALS = 0.8
# Part of a region's corners on such edges in a box.
_BOX_PART = 0.6

# Logarithms of odds. The whole picture in the colours of a substance makes it 20 times as likely; a name less, because
# one material often covers several stuffs, and names are left over from templates.
_COLOUR, _MATERIAL_NAME, _NAME = 3.0, 2.0, 1.5
# Eyes, teeth, hair and nails have the colours of anything: there the name says more than the picture.
_HARD_NAME = 6.0
# Where nothing is convincing it is skin.
_SKIN_ELSE = 0.3
# The part of the body breaks ties: hands and faces are bare on most characters, feet are shod, and trunks are dressed.
_BARE: tuple[Part, ...] = ("hand", "palm", "finger", "neck", "head", "jaw", "eye")
_SHOD: tuple[Part, ...] = ("foot", "toes")
_DRESSED: tuple[Part, ...] = ("hips", "spine", "chest", "shoulder", "upper leg", "lower leg", "upper arm")
_OF_BODY = 1.0
_OF_TRUNK = 0.4
# Chroma of Oklab below which a plain colour is grey, which is what modelling programs give a new surface, and palettes
# to metal; and the deviation of lightness below which a picture is plain: that of dyed cloth is 0.02 to 0.1.
_GREY, _PLAIN = 0.02, 0.015
# Lightness of Oklab of the darkest skin, and from which on a brown is no longer too dark for skin: it has 0.32 to 0.95,
# the leather of most shoes 0.2 to 0.45.
_DARK = (0.25, 0.37)
# Parts of the body that show bare skin, the surest first: heads have hair.
_SHOWING: tuple[tuple[Part, ...], ...] = (("hand", "palm", "finger"), ("head",))
# Distance in Oklab from the bare skin beyond which a colour of human skin is less and less likely skin, up to twice as
# far: soles and lips differ, but not as brown trousers do. Any colour that is half as far is the bare skin's.
_SKIN_APART = 0.05
_NOT_BARE = 0.7
# Part of the hands and of the head that a colour has at least if it is the skin's: a face is a third of a head.
_SHARED = 0.2
# Colours that are tried as the skin's: one on a tenth of the hands is among them.
_TRIED = 128
# How far a colour that leather and cloth have alike looks like leather.
_EITHER = 0.45
# Confidence from which on a substance is called sure, and likely.
_SURE, _LIKELY = 0.85, 0.6


@dataclass(frozen=True, slots=True)
class Substance:
    """The substance of a region, and what in the file says so.

    Attributes:
        kind: The substance; "none" if the user asks for a plain tool.
        why: What says so, to follow "it is KIND, ".
        confidence: The probability that it is so, 0 to 1, if the evidence is weighed rightly.
        stiff: For hard parts a word for why: metal, rigid, fur or hard.
    """

    kind: SubstanceKind
    why: str
    confidence: float = 1.0
    stiff: str = "hard"

    @property
    def material(self) -> MaterialName | None:
        """The material of a tool; None, for a plain tool, on hard parts."""
        return None if self.kind == "hard" or self.kind == "none" else self.kind

    @property
    def is_guess(self) -> bool:
        """True if no colour and no name says anything."""
        return self.why == _UNTOLD

    @property
    def words(self) -> str:
        """The substance, the reason and the confidence, as a user reads them."""
        sure = "sure" if self.confidence >= _SURE else "likely" if self.confidence >= _LIKELY else "a guess"
        return f"{self.kind}, {self.why}" + ("" if self.why == BY_USER else f" ({sure})")

    @property
    def fault(self) -> str:
        """The reason why hard parts get no tool, as a user reads it."""
        return f"it is {'fur' if self.stiff == 'fur' else 'hard'}, {self.why}"


@dataclass(frozen=True, slots=True)
class PrimitiveHints:
    """Find what names say of a primitive: its material's, those of node and mesh, and the user by one of them."""

    material: Substance | None
    node: Substance | None
    asked: Substance | None


@dataclass(frozen=True, slots=True)
class BareSkin:
    """The bare skin of a character.

    Attributes:
        colour: (3,) in Oklab.
        everywhere: True if it is no human's, and most of the trunk and limbs have it too: those of a mannequin, a robot
            or a creature that wears nothing. Then the colour does not tell which.
    """

    colour: Floats
    everywhere: bool = False


@dataclass(frozen=True, slots=True)
class Makeup:
    """Hints about the substance of a gauge's triangles.

    Attributes:
        hints: Hints about each primitive.
        primitives: (triangles,) number of the triangle's primitive.
        boxed: (triangles, 3) True for a corner on an edge of a box.
        followed: (triangles, 3) the joint that a corner follows alone; -1 if it follows several.
        corners: (triangles, 3) glTF vertices.
        vertex_starts: (primitives + 1,) the first glTF vertex of each primitive.
        mesh: Index of the mesh.
        unshod: (triangles,) True on pieces of the surface that hands share: shoes are pieces of their own.
        pictures: Its textures.
        bare: The character's bare skin; None if unknown.
        animal: True if the character is an animal, whose coat may have the colours and the grain of any cloth.
    """

    hints: tuple[PrimitiveHints, ...]
    primitives: Ints
    boxed: Bools
    followed: Ints
    corners: Ints
    vertex_starts: Ints
    mesh: int
    unshod: Bools
    pictures: Pictures = field(compare=False, repr=False)
    bare: BareSkin | None = None
    animal: bool = False

    @property
    def shown(self) -> Floats:
        """(triangles,) the part of each that alpha does not cut away."""
        return self.pictures.shown(self.mesh, self.primitives, self.corners, self.vertex_starts)


def read_makeup(
    document: Document,
    rig: Rig,
    gauge: Gauge,
    *,
    pictures: Pictures | None = None,
) -> Makeup:
    """Gather the hints that names, normals and weights give about a mesh.

    Args:
        document: The document.
        rig: Moves the mesh.
        gauge: Has the mesh's triangles.
        pictures: The textures of the document that other meshes have read.
    """
    surface = gauge.surface
    corners, triangles = surface.corners[gauge.numbers], gauge.triangles
    alone = surface.weights.max(axis=1) >= _RIGID_WEIGHT
    followed = np.where(alone & rig.skinned, surface.heaviest, -1)
    return Makeup(
        read_hints(document, rig),
        surface.primitives[gauge.numbers],
        _boxed(surface.positions, unit(surface.normals), triangles, corners)[triangles],
        followed[triangles],
        corners,
        surface.vertex_starts,
        rig.mesh,
        np.zeros(len(triangles), np.bool_),
        pictures or Pictures(document),
    )


def _boxed(positions: Floats, normals: Floats, triangles: Ints, corners: Ints) -> Bools:
    """(vertices,) True for those on the edges of flat-shaded boxes: the normals of their faces differ by 90°."""
    shaded, flat = normals[corners], unit(face_normals(positions, triangles))[:, None]
    missing = ~shaded.any(axis=2, keepdims=True)
    shaded = np.where(missing, flat, shaded)
    # One normal for each direction of a point, as a face's two triangles do not count twice.
    vertices = triangles.ravel()
    rounded = np.round(shaded.reshape(-1, 3) * 16.0)
    distinct = np.unique(np.concatenate([vertices[:, None], rounded], axis=1), axis=0)
    sums = np.stack(
        [np.bincount(distinct[:, 0].astype(int), unit(distinct[:, 1:])[:, k], len(positions)) for k in range(3)]
    )
    counts = np.bincount(distinct[:, 0].astype(int), minlength=len(positions))
    return np.asarray((np.sqrt(np.sum(sums**2, axis=0)) < _BOX_NORMALS * counts) & (counts > 1))


def read_hints(
    document: Document, rig: Rig, asked: Mapping[str, SubstanceKind] | None = None, *, animal: bool = False
) -> tuple[PrimitiveHints, ...]:
    """The hints that names give about each primitive of a rig's mesh, and what the user asks for by name.

    The names of animals count if it is an `animal`.
    """
    mesh = document.items("meshes")[rig.mesh]
    names = [name for name in (mesh.get("name"), rig.node_name) if isinstance(name, str)]
    node, materials, wanted = named(names, "the mesh", animal=animal), document.items("materials"), asked or {}
    found = []
    for primitive in mesh["primitives"]:
        number = primitive.get("material", len(materials))
        name = materials[number].get("name") if number < len(materials) else None
        own = [name] if isinstance(name, str) else []
        # The material is the closest to the place, and the node closer than a mesh that several nodes share.
        kind = next((wanted[each] for each in [*own, *names[::-1]] if each in wanted), None)
        asked_for = None if kind is None else Substance(kind, BY_USER)
        found.append(PrimitiveHints(named(own, "its material", animal=animal), node, asked_for))
    return tuple(found)


def substance_of(makeup: Makeup, weights: Floats, part: Part | None = None, *, by_morph: bool = False) -> Substance:
    """The substance of a region.

    Args:
        makeup: Hints about the mesh.
        weights: (triangles,) `triangle_weights` of the region.
        part: The part of the body of the joint that bends the region, if known.
        by_morph: True if a morph target deforms the region, so that it is no plates that only joints move.
    """
    (found,) = _substances(makeup, [_Place(np.arange(len(weights)), weights, part)], by_morph=by_morph)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Numbers of triangles, how much of the place each of them has, and the part of the body."""

    triangles: Ints
    weights: Floats
    part: Part | None


def _substances(makeup: Makeup, places: Sequence[_Place], *, by_morph: bool) -> Iterator[Substance]:
    """The substances of places, as `substance_of`."""
    for chosen in portions(len(places), SAMPLED):
        some = places[chosen]
        swatches = _swatches(makeup, [(each.triangles, np.maximum(each.weights, 0.0)) for each in some])
        looks = _by_looks(swatches, makeup.bare)
        for place, metallic, pictured, look in zip(some, swatches.metallic, swatches.pictured, looks, strict=True):
            by_picture = "by its texture" if pictured > 0.5 else "by its colour"
            yield _substance(makeup, place, bool(metallic >= _METALLIC), {by_picture: look}, by_morph=by_morph)


def _substance(
    makeup: Makeup, place: _Place, metal: bool, looks: dict[str, dict[SubstanceKind, float]], *, by_morph: bool
) -> Substance:
    """The substance of a place with looks, each with its reason."""
    of_primitives = np.bincount(makeup.primitives[place.triangles], place.weights, len(makeup.hints))
    hints = makeup.hints[int(of_primitives.argmax())]
    if hints.asked is not None:
        return hints.asked
    named_soft = hints.material is not None and hints.material.kind != "hard"
    hard = _hard(makeup, place, metal, plates=not (by_morph or named_soft))
    if hard is None and makeup.animal and hints.material is None and hints.node is None:
        return Substance("skin", "as animals wear nothing", 2.0 / 3.0)
    unshod = float(place.weights @ makeup.unshod[place.triangles]) > 0.5 * float(place.weights.sum())
    return hard or _soft(hints, looks, place.part, unshod=unshod)


def _hard(makeup: Makeup, place: _Place, metal: bool, *, plates: bool) -> Substance | None:
    """A hard substance if a region is metal, or, if they are looked for, plates or a box."""
    weights = place.weights
    corners = np.repeat(weights / 3.0, 3)
    total = float(corners.sum())
    by_joint = np.bincount(makeup.followed[place.triangles].ravel() + 1, corners)[1:] / total
    rigid = plates and by_joint.sum() > _RIGID_PART and (by_joint > _SECOND_JOINT).sum() > 1
    boxed = plates and float(weights @ makeup.boxed[place.triangles].mean(axis=1)) > _BOX_PART * total
    looks = (
        ["it is metallic"] * metal
        + ["each part of it follows one joint"] * bool(rigid)
        + ["it is a box with flat faces"] * boxed
    )
    if not looks:
        return None
    return Substance("hard", "as " + " and ".join(looks), 0.95, "metal" if metal else "rigid")


def _soft(
    hints: PrimitiveHints, looks: dict[str, dict[SubstanceKind, float]], part: Part | None, *, unshod: bool
) -> Substance:
    """The likeliest substance by looks, names and the part of the body."""
    evidence: dict[str, dict[SubstanceKind, float]] = {
        **looks,
        "by the name of its material": _by_name(hints.material, _MATERIAL_NAME),
        "by its name": _by_name(hints.node, _NAME),
    }
    said = {reason: found for reason, found in evidence.items() if any(found.values())}
    on_body: dict[SubstanceKind, float] = {"skin": _SKIN_ELSE}
    if part in _BARE:
        on_body = {"skin": _OF_BODY}
    elif part in _SHOD:
        on_body = {"leather": _OF_BODY}
    elif part in _DRESSED and said:
        on_body = {"cloth": _OF_TRUNK}
    kinds: tuple[SubstanceKind, ...] = ("skin", "cloth", "leather", "hard")
    seen, *names = evidence.values()
    # Several names come from one mind, and make it no likelier than one does.
    scores = np.array(
        [seen.get(kind, 0.0) + max(each.get(kind, 0.0) for each in names) + on_body.get(kind, 0.0) for kind in kinds]
    )
    scores[-1] -= _SKIN_ELSE if scores[-1] else np.inf
    if not said:
        # Shoes without a word or a colour are a guess, and so is all else; those of cloth are the commonest today.
        # Feet in one piece with hands are as bare as these.
        return Substance("cloth" if part in _SHOD and not unshod else "skin", _UNTOLD, 1.0 / 3.0)
    odds = np.exp(scores - scores.max())
    best = int(scores.argmax())
    kind = kinds[best]
    why = max(said, key=lambda reason: said[reason].get(kind, 0.0))
    if not said[why].get(kind, 0.0) > 0.0:
        why = "by its place on the body"
    of_name = hints.material if why == "by the name of its material" else hints.node if why == "by its name" else None
    if of_name is not None:
        why = f"as {of_name.why}"
    stiff = "fur" if any(each is not None and each.stiff == "fur" for each in (hints.material, hints.node)) else "hard"
    return Substance(kind, why, float(odds[best] / odds.sum()), stiff if kind == "hard" else "hard")


def _by_name(named_as: Substance | None, strength: float) -> dict[SubstanceKind, float]:
    if named_as is None:
        return {}
    return {named_as.kind: _HARD_NAME if named_as.kind == "hard" else strength}


def _by_looks(swatches: Swatches, bare: BareSkin | None) -> list[dict[SubstanceKind, float]]:
    """Find what colours say of each place."""
    lightness, chroma, hue = _polar(swatches.colours)
    skin = _skin_like(swatches.colours)
    brown = np.exp(-0.5 * ((hue - 56.0) / 20.0) ** 2) * ramp(chroma, 0.012, 0.03)
    brown *= ramp(lightness, _DARK[1] + 0.12, _DARK[0])
    # Black is the colour of leather and of cloth: the place decides.
    black = ramp(lightness, 0.35, 0.25) * ramp(chroma, 0.03, 0.015)
    tanned = np.maximum(brown, _EITHER * black)
    said = swatches.coloured > 0.5
    if bare is not None:
        apart = difference(swatches.colours, bare.colour)
        said &= ~(bare.everywhere & (_same(apart).mean(axis=1) > 0.5))
        skin = np.maximum(skin * (1.0 - _NOT_BARE * ramp(apart, _SKIN_APART, 2.0 * _SKIN_APART)), _same(apart))
    found: dict[SubstanceKind, Floats] = {
        "skin": _COLOUR * skin.mean(axis=1),
        "leather": 0.9 * _COLOUR * tanned.mean(axis=1),
        "cloth": _COLOUR * (1.0 - np.maximum(skin, tanned)).mean(axis=1),
    }
    grey = (chroma.mean(axis=1) < _GREY) & (lightness.mean(axis=1) > _DARK[0])
    plain = (swatches.pictured < 0.5) | (lightness.std(axis=1) < _PLAIN)
    said &= ~(grey & plain)
    return [
        {kind: float(values[place]) for kind, values in found.items()} if says else {}
        for place, says in enumerate(said.tolist())
    ]


def _polar(colours: Floats) -> tuple[Floats, Floats, Floats]:
    """(…,) lightness from 0 to 1, chroma and hue of (…, 3) colours in Oklab.

    Grey has a chroma of 0, vivid colours have 0.2. The hue is in degrees from 0 to 360: red has 29, skin about 55.
    """
    lightness, a, b = np.moveaxis(colours, -1, 0)
    return lightness, np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360.0


def _alive(colours: Floats) -> Floats:
    """(…,) 1 for (…, 3) colours that skin may have, be it a cartoon's, 0 for greys and what is darker than any skin."""
    lightness, chroma, _ = _polar(colours)
    return ramp(chroma, 0.012, 0.03) * ramp(lightness, *_DARK)


def _skin_like(colours: Floats) -> Floats:
    """(…,) 1 for (…, 3) colours of human skin, 0 for others.

    Haemoglobin and melanin give skin, pale and dark, hues around orange, and never vivid ones.
    """
    _, chroma, hue = _polar(colours)
    of_hue = ramp(hue, 15.0, 30.0) * ramp(hue, 88.0, 74.0)
    return of_hue * ramp(chroma, 0.165, 0.13) * _alive(colours)


def find_bare_skin(meshes: Sequence[tuple[Gauge, Makeup]], parts: Sequence[Part | None]) -> BareSkin | None:
    """A character's bare skin, or None.

    It has the colour of the hands, or else of the head, if most of them have that of human skin. Else it is the one
    that both have, such as a cartoon's pink or a goblin's green.

    Args:
        meshes: Those of the character.
        parts: (nodes,) the part of the body that each node moves.
    """
    shown = [_colours_shown(meshes, parts, showing) for showing in _SHOWING]
    for colours, shares in shown:
        human = _skin_like(colours) * shares
        if human.sum() > 0.5:
            tried = _some(colours)
            return BareSkin(tried[(_near(tried, colours) @ human).argmax()])
    tried = _some(shown[0][0])
    shared = np.min([_near(tried, colours) @ shares for colours, shares in shown], axis=0)
    shared *= _alive(tried)
    if shared.max(initial=0.0) <= _SHARED:
        return None
    colour = tried[shared.argmax()]
    colours, shares = _colours_shown(meshes, parts, _DRESSED)
    return BareSkin(colour, everywhere=float(_near(colour[None], colours)[0] @ shares) > 0.5)


def _near(colours: Floats, others: Floats) -> Floats:
    """(colours, others) 1 where (colours, 3) colours are those of (others, 3), and 0 where they are not."""
    return _same(difference(colours[:, None], others))


def _same(apart: Floats) -> Floats:
    """(…,) 1 where colours are so little apart that they are the same skin's, 0 where they are not."""
    return ramp(apart, _SKIN_APART, _SKIN_APART / 2.0)


def _some(colours: Floats) -> Floats:
    """(tried, 3) colours, evenly chosen: each is held against all."""
    return colours[:: 1 + len(colours) // _TRIED]


def _colours_shown(
    meshes: Sequence[tuple[Gauge, Makeup]], parts: Sequence[Part | None], showing: tuple[Part, ...]
) -> tuple[Floats, Floats]:
    """(points, 3) colours of parts of the body, and (points,) shares of their area, without what is named otherwise."""
    found, shares = [np.zeros((0, 3))], [np.zeros(0)]
    for gauge, makeup in meshes:
        surface, rig = gauge.surface, gauge.rig
        if not rig.skinned:
            continue
        inside = np.array([parts[joint] in showing for joint in rig.joints.tolist()])[surface.heaviest]
        bare = np.array(
            [all(each is None or each.kind == "skin" for each in (hint.material, hint.node)) for hint in makeup.hints]
        )
        areas = np.where(inside[gauge.triangles].all(axis=1) & bare[makeup.primitives], gauge.areas, 0.0)
        if not areas.any():
            continue
        swatches = _swatches(makeup, [(np.arange(len(areas)), areas)])
        if swatches.coloured[0] > 0.5 and swatches.metallic[0] < _METALLIC:
            found.append(swatches.colours[0])
            shares.append(np.full(len(found[-1]), areas.sum()))
    every = np.concatenate(shares)
    return np.concatenate(found), every / max(float(every.sum()), TINY)


def makeup_of(ground: Ground, gauge: Gauge) -> Makeup:
    """The hints about the triangles of a gauge of the mesh, with the bare skin that all meshes of the file show."""
    document, rig, animal = ground.document, gauge.rig, is_animal(gauge.rig)
    makeup = read_makeup(document, rig, gauge, pictures=ground.pictures)
    bare = None if animal else once(ground.neighbours.known, "bare skin", lambda: _bare_skin_beside(ground))
    hands = np.array([part in _SHOWING[0] for part in ground.neighbours.parts])[rig.joints][gauge.surface.heaviest]
    unshod = among(gauge.pieces, distinct_values(gauge.pieces[hands[gauge.triangles].all(axis=1)])) & (
        gauge.pieces >= 0
    )
    return replace(makeup, hints=read_hints(document, rig, animal=animal), bare=bare, animal=animal, unshod=unshod)


def _bare_skin_beside(ground: Ground) -> BareSkin | None:
    """The `find_bare_skin` of all meshes of the file: a coat may show no hand, and be as brown as one."""
    document, meshes = ground.document, []
    shown = {each["mesh"]: node for node, each in enumerate(document.items("nodes")) if {"mesh", "skin"} <= set(each)}
    for node in shown.values():
        try:
            other = read_ground(document, node, [], ToolsFile(path=document.path), ())
        except AssetError:
            continue
        gauge = read_gauge(other.surface, other.rest, other.rig)
        meshes.append((gauge, read_makeup(document, other.rig, gauge, pictures=ground.pictures)))
    return find_bare_skin(meshes, ground.neighbours.parts)


def is_animal(rig: Rig) -> bool:
    """True if a rig has a tail, wings or front legs, and no thumb."""
    names = [words_of(rig.names[joint]) for joint in rig.joints.tolist()]
    return any(map(_BEASTLY.search, names)) and not any(map(_HUMAN.search, names))


def _swatches(makeup: Makeup, places: Sequence[tuple[Ints, Floats]]) -> Swatches:
    return makeup.pictures.swatches(makeup.mesh, makeup.primitives, makeup.corners, makeup.vertex_starts, places)


def substances_at(ground: Ground) -> Ints:
    """(triangles,) numbers in `SUBSTANCES` of all triangles of a mesh, piece by piece; "none" where one has no area.

    Connected parts of a primitive may be plates or boxes as a whole. Else each has pieces of one colour.
    """
    return once(ground.known, "substances", lambda: _substances_at(ground))


def _substances_at(ground: Ground) -> Ints:
    rig, surface, bodies = ground.rig, ground.surface, ground.neighbours.parts
    gauge = read_gauge(surface, ground.rest, rig)
    makeup = makeup_of(ground, gauge)
    areas, nodes = gauge.areas, rig.joints[surface.heaviest][gauge.triangles[:, 0]]

    def of_places(places: Sequence[Ints], *, by_morph: bool) -> None:
        parts = [None if makeup.animal else bodies[int(np.bincount(nodes[own], areas[own]).argmax())] for own in places]
        every = [_Place(own, areas[own], part) for own, part in zip(places, parts, strict=True)]
        for own, substance in zip(places, _substances(makeup, every, by_morph=by_morph), strict=True):
            found[gauge.numbers[own]] = SUBSTANCES.index(substance.kind)

    found = np.full(len(surface.triangles), SUBSTANCES.index("none"))
    wholes = np.stack([makeup.primitives, gauge.pieces], axis=1)
    of_places(groups_of(distinct(wholes)[1]), by_morph=False)
    remaining = np.flatnonzero(found[gauge.numbers] != SUBSTANCES.index("hard"))
    colours = makeup.pictures.colours(makeup.mesh, makeup.primitives, makeup.corners, makeup.vertex_starts)
    # What the part of the body says is said of all of a piece, so shoes end where trousers as black as they begin.
    shod = np.array([part in _SHOD for part in bodies])[nodes]
    pieces = pieces_of(gauge.triangles, 2 * makeup.primitives + shod, colours, areas)
    of_places([remaining[own] for own in groups_of(pieces[remaining])], by_morph=True)
    return found


def is_rigid(gauge: Gauge) -> bool:
    """True if a mesh is plates, each of which follows one joint."""
    return gauge.rig.skinned and bool((gauge.surface.weights.max(axis=1) >= _RIGID_WEIGHT).all())


def named(names: Iterable[str], of: str, *, animal: bool = False) -> Substance | None:
    """The substance that the words of names say, the first name first; None if they say nothing.

    Names of furred animals say something of an `animal` alone.
    """
    for name in names:
        words = {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}
        kinds = {_KIND_OF.get(word) or _KIND_OF.get(word.removesuffix("s")) for word in words}
        singular = {word.removesuffix("s") for word in words}
        if singular & {*_FUR.split(), *(_FURRED.split() if animal else ())}:
            return Substance("hard", f"{of} is named {shortened(name, 40)}", stiff="fur")
        for kind in WORDS:
            if kind in kinds or re.search(_JAPANESE[kind], name):
                return Substance(kind, f"{of} is named {shortened(name, 40)}")
    return None
