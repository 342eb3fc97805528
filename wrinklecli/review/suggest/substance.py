"""What a surface is made of: skin, cloth, leather, or hard parts that do not wrinkle.

The material's name says most. Then come its factors and the skin weights, the names of mesh and node, and the colour.
What nothing is said of counts as skin, whose wrinkles are the lowest.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.choices import MaterialName
from wrinklecli.errors import shortened
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, unit
from wrinklecli.surface.strain import Gauge

Kind = MaterialName | Literal["hard"]

# Words of names, singular; the kind that stands first wins. Hair, eyes and teeth are parts of a body that no fold
# crosses. Among them those of Ready Player Me (`Wolf3D_Outfit_Footwear`), Daz (`EyeMoisture`, `Fingernails`) and
# Character Creator (`Std_Eye_Occlusion`).
_WORDS: dict[Kind, str] = {
    "leather": "leather boot shoe sneaker footwear sandal belt strap glove saddle holster pouch",
    "hard": """metal metallic steel iron chrome gold silver brass copper alloy armor armour robot bot mech machine
        plastic glass glasses eyewear goggle stone wood wooden plate screw bolt gear helmet headwear visor lens gun
        weapon sword shield buckle button zipper rubber wheel jewelry earring necklace hair eyebrow brow beard lash
        eyelash eye iris irises cornea pupil sclera tearline eyemoisture tooth teeth tongue gum nail fingernail toenail
        horn claw hoof""",
    "cloth": """cloth clothes clothing shirt tshirt trouser pant jeans denim jacket coat cape cloak robe dress skirt
        sleeve fabric cotton wool silk linen sock stocking legging tights scarf hood hoodie sweater suit bodysuit short
        tunic uniform top bottom onepiece kimono apron vest underwear bra panties blouse garment outfit textile hat cap
        tie""",
    "skin": "skin flesh body face head hand wrist arm leg foot neck finger ear nose torso dermis",
}
_KIND_OF: dict[str, Kind] = {word: kind for kind, words in reversed(_WORDS.items()) for word in words.split()}
# The same in Japanese, whose words stand together: of MikuMikuDance and VRM models.
_JAPANESE: dict[Kind, str] = {
    "leather": "革|靴(?!下)|ブーツ|ベルト|手袋",
    "hard": "金属|金具|鎧|眼鏡|メガネ|ボタン|髪|目|瞳|眉|睫|まつげ|歯|舌|爪|角",
    "cloth": "服|布|袖|襟|シャツ|ズボン|パンツ|スカート|上着|コート|マント|帽子|靴下|リボン|ネクタイ|タイツ|着",
    "skin": "肌|顔|体|首|手|足|腕",
}
# A metallic factor from which a material is a metal; what is dirty or woven with wire has less.
_METALLIC = 0.5
# Weight of one joint from which a vertex follows it alone, and the part of a region's corners that do in a rigid one.
_RIGID_WEIGHT, _RIGID_SHARE = 0.98, 0.9
# Part of a rigid region that follows a second joint at least: else all of it moves as one, as a face on its head does.
_SECOND_JOINT = 0.05
# Length of the mean of the unit normals of one point, below which they differ: by 20° from each other, of two.
_SPLIT_NORMALS = 0.985
# Part of a region's corners with split normals in a faceted one.
_FACETED_SHARE = 0.6
# Ratios of red to green and of green to blue of human skin, linear RGB, pale and dark.
_SKIN_RED, _SKIN_GREEN = (1.2, 2.8), (1.0, 2.6)


@dataclass(frozen=True, slots=True)
class Substance:
    """What a region is made of.

    Attributes:
        kind: What it wrinkles like.
        why: What says so.
    """

    kind: Kind
    why: str


@dataclass(frozen=True, slots=True)
class _Part:
    """What the file says of a primitive."""

    material: Substance | None
    metallic: bool
    node: Substance | None
    colour: Substance | None


@dataclass(frozen=True, slots=True)
class Makeup:
    """What is known of a mesh's triangles.

    Attributes:
        parts: Of each primitive.
        primitives: (triangles,) of the gauge, the primitive of each.
        split: (triangles, 3) whether the authored normals at a corner differ, or are missing.
        followed: (triangles, 3) the joint that a corner follows alone; -1 where it follows several.
    """

    parts: tuple[_Part, ...]
    primitives: np.ndarray[Any, np.dtype[np.intp]]
    split: Bools
    followed: np.ndarray[Any, np.dtype[np.intp]]


def read_makeup(document: Document, rig: Rig, gauge: Gauge) -> Makeup:
    """Gather what names, factors, normals and weights say of a mesh."""
    surface = gauge.surface
    mesh = document.items("meshes")[rig.mesh]
    names = [name for name in (mesh.get("name"), rig.names[rig.node]) if isinstance(name, str)]
    node = named(names, "the mesh")
    parts = tuple(_part(document, primitive, node) for primitive in mesh["primitives"])
    count = len(surface.positions)
    normals = unit(surface.normals)
    sums = np.stack([np.bincount(surface.weld, normals[:, k], count) for k in range(3)], axis=1)
    of_point = np.bincount(surface.weld, minlength=count)
    split = np.sqrt(np.sum(sums**2, axis=1)) < _SPLIT_NORMALS * of_point
    greatest = surface.weights.argmax(axis=1)
    rows = np.arange(count)
    alone = surface.weights[rows, greatest] >= _RIGID_WEIGHT
    followed = np.where(alone & rig.skinned, surface.joints[rows, greatest], -1)
    return Makeup(parts, surface.primitives[gauge.numbers], split[gauge.triangles], followed[gauge.triangles])


def substance_of(makeup: Makeup, shares: Floats) -> Substance:
    """What a region is made of, from the (triangles,) shares that triangles have in it."""
    of_parts = np.bincount(makeup.primitives, shares, len(makeup.parts))
    part = makeup.parts[int(of_parts.argmax())]
    if part.material is not None:
        return part.material
    corners = np.repeat(shares / 3.0, 3)
    total = float(corners.sum())
    followed = makeup.followed.ravel()
    by_joint = np.bincount(followed + 1, corners)[1:] / total
    rigid = by_joint.sum() > _RIGID_SHARE and (by_joint > _SECOND_JOINT).sum() > 1
    looks = ["it is metallic"] * part.metallic + ["each part of it follows one joint"] * bool(rigid)
    if looks:
        return Substance("hard", " and ".join([*looks, *(["it is faceted"] if is_faceted(makeup, shares) else [])]))
    return part.node or part.colour or Substance("skin", "nothing says what it is made of")


def is_faceted(makeup: Makeup, shares: Floats) -> bool:
    """Whether a region is shaded flat, from the (triangles,) shares that triangles have in it."""
    return float(shares @ makeup.split.mean(axis=1)) > _FACETED_SHARE * float(shares.sum())


def named(names: Iterable[str], of: str) -> Substance | None:
    """What the words of names say, those of the first name first; none where they say nothing."""
    for name in names:
        words = {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}
        kinds = {_KIND_OF.get(word) or _KIND_OF.get(word.removesuffix("s")) for word in words}
        for kind in _WORDS:
            if kind in kinds or re.search(_JAPANESE[kind], name):
                return Substance(kind, f"{of} is named {shortened(name, 40)}")
    return None


def _part(document: Document, primitive: Json, node: Substance | None) -> _Part:
    materials = document.items("materials")
    number = primitive.get("material", len(materials))
    material: Json = materials[number] if number < len(materials) else {}
    name = material.get("name")
    looks = material.get("pbrMetallicRoughness")
    looks = looks if isinstance(looks, dict) else {}
    # Without the key a material is metallic too, which many files do not mean.
    factor = looks.get("metallicFactor", 0.0)
    metallic = isinstance(factor, int | float) and factor >= _METALLIC and "metallicRoughnessTexture" not in looks
    colour = None if "baseColorTexture" in looks else _coloured(looks.get("baseColorFactor"))
    of_name = named([name], "its material") if isinstance(name, str) else None
    return _Part(of_name, bool(metallic), node, colour)


def _coloured(factor: object) -> Substance | None:
    """What a plain colour says; none where there is none."""
    if not isinstance(factor, list) or len(factor) != 4 or not all(isinstance(x, int | float) for x in factor):
        return None
    red, green, blue = (float(x) for x in factor[:3])
    if not (red > 0.0 and green > 0.0 and blue > 0.0):
        return Substance("cloth", "of its colour")
    skin = _SKIN_RED[0] <= red / green <= _SKIN_RED[1] and _SKIN_GREEN[0] <= green / blue <= _SKIN_GREEN[1]
    return Substance("skin" if skin else "cloth", "of its colour")
