"""The substance of a surface: skin, cloth, leather, or hard parts that do not wrinkle.

The material's name says most. Then come its factors and the skin weights, the names of mesh and node, and the colour.
A surface about which the file says nothing counts as skin, whose wrinkles are the lowest.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.choices import MaterialName
from wrinklecli.errors import shortened
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints, unit
from wrinklecli.surface.strain import Gauge

SubstanceKind = MaterialName | Literal["hard"]

# Words of names, singular; the first kind wins. No fold crosses hair, eyes and teeth. Some words are those of Ready
# Player Me (`Wolf3D_Outfit_Footwear`), Daz (`EyeMoisture`, `Fingernails`) and Character Creator (`Std_Eye_Occlusion`).
_WORDS: dict[SubstanceKind, str] = {
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
_KIND_OF: dict[str, SubstanceKind] = {word: kind for kind, words in reversed(_WORDS.items()) for word in words.split()}
# Japanese words, which have no spaces between them, of MikuMikuDance and VRM models.
_JAPANESE: dict[SubstanceKind, str] = {
    "leather": "革|靴(?!下)|ブーツ|ベルト|手袋",
    "hard": "金属|金具|鎧|眼鏡|メガネ|ボタン|髪|目|瞳|眉|睫|まつげ|歯|舌|爪|角",
    "cloth": "服|布|袖|襟|シャツ|ズボン|パンツ|スカート|上着|コート|マント|帽子|靴下|リボン|ネクタイ|タイツ|着",
    "skin": "肌|顔|体|首|手|足|腕",
}
# Least metallic factor of a metal; dirty metal, and cloth woven with wire, have less.
_METALLIC = 0.5
# Least weight of a joint that a vertex follows alone.
_RIGID_WEIGHT = 0.98
# Part of a region's corners that follow one joint each in a rigid region.
_RIGID_PART = 0.9
# Least part of a rigid region that follows a second joint: else all of it moves as one, as a face moves with its head.
_SECOND_JOINT = 0.05
# Length of the mean unit normal of a point below which its normals are split: two differ by 20°.
_SPLIT_NORMALS = 0.985
# Part of a region's corners with split normals in a faceted region.
_FACETED_PART = 0.6
# Red over green of human skin, pale and dark, linear RGB.
_SKIN_RED = (1.2, 2.8)
# Green over blue of human skin, likewise.
_SKIN_GREEN = (1.0, 2.6)


@dataclass(frozen=True, slots=True)
class Substance:
    """The substance of a region, and what in the file says so."""

    kind: SubstanceKind
    why: str

    @property
    def material(self) -> MaterialName | None:
        """The material of a tool; None, for a plain tool, on hard parts."""
        return None if self.kind == "hard" else self.kind


@dataclass(frozen=True, slots=True)
class PrimitiveHints:
    """The substances of a primitive according to its material's name, its node and its colour."""

    material: Substance | None
    metallic: bool
    node: Substance | None
    colour: Substance | None


@dataclass(frozen=True, slots=True)
class Makeup:
    """Hints about the substance of a gauge's triangles.

    Attributes:
        hints: Hints about each primitive.
        primitives: (triangles,) number of the triangle's primitive.
        split: (triangles, 3) True if the authored normals at a corner differ, or are missing.
        followed: (triangles, 3) the joint that a corner follows alone; -1 if it follows several.
        radii: (triangles,) greatest distance of a corner from the centroid, scene units.
    """

    hints: tuple[PrimitiveHints, ...]
    primitives: Ints
    split: Bools
    followed: Ints
    radii: Floats


def read_makeup(document: Document, rig: Rig, gauge: Gauge) -> Makeup:
    """Gather the hints that names, factors, normals and weights give about a mesh."""
    surface = gauge.surface
    count = len(surface.positions)
    normals = unit(surface.normals)
    sums = np.stack([np.bincount(surface.weld, normals[:, k], count) for k in range(3)], axis=1)
    of_point = np.bincount(surface.weld, minlength=count)
    split = np.sqrt(np.sum(sums**2, axis=1)) < _SPLIT_NORMALS * of_point
    greatest = surface.weights.argmax(axis=1)
    rows = np.arange(count)
    alone = surface.weights[rows, greatest] >= _RIGID_WEIGHT
    followed = np.where(alone & rig.skinned, surface.joints[rows, greatest], -1)
    primitives = surface.primitives[gauge.numbers]
    return Makeup(read_hints(document, rig), primitives, split[gauge.triangles], followed[gauge.triangles], gauge.radii)


def read_hints(document: Document, rig: Rig) -> tuple[PrimitiveHints, ...]:
    """The hints that names and materials give about each primitive of a rig's mesh."""
    mesh = document.items("meshes")[rig.mesh]
    names = [name for name in (mesh.get("name"), rig.names[rig.node]) if isinstance(name, str)]
    node = named(names, "the mesh")
    return tuple(_hints_of(document, primitive, node) for primitive in mesh["primitives"])


def substance_of(makeup: Makeup, weights: Floats) -> Substance:
    """The substance of a region with (triangles,) `triangle_weights`."""
    of_primitives = np.bincount(makeup.primitives, weights, len(makeup.hints))
    hints = makeup.hints[int(of_primitives.argmax())]
    if hints.material is not None:
        return hints.material
    corners = np.repeat(weights / 3.0, 3)
    total = float(corners.sum())
    followed = makeup.followed.ravel()
    by_joint = np.bincount(followed + 1, corners)[1:] / total
    rigid = by_joint.sum() > _RIGID_PART and (by_joint > _SECOND_JOINT).sum() > 1
    looks = ["it is metallic"] * hints.metallic + ["each part of it follows one joint"] * bool(rigid)
    if looks:
        return Substance("hard", " and ".join([*looks, *(["it is faceted"] if _is_faceted(makeup, weights) else [])]))
    return hints.node or hints.colour or Substance("skin", "nothing says what it is made of")


def facet_length(makeup: Makeup, weights: Floats) -> float:
    """Length of the triangles' edges in a region that is shaded flat, scene units; 0 in a smooth one."""
    # The edges of equilateral triangles with these radii.
    return 3.0**0.5 * float(weights @ makeup.radii) if _is_faceted(makeup, weights) else 0.0


def _is_faceted(makeup: Makeup, weights: Floats) -> bool:
    return float(weights @ makeup.split.mean(axis=1)) > _FACETED_PART * float(weights.sum())


def named(names: Iterable[str], of: str) -> Substance | None:
    """The substance that the words of names say, the first name first; None if they say nothing."""
    for name in names:
        words = {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}
        kinds = {_KIND_OF.get(word) or _KIND_OF.get(word.removesuffix("s")) for word in words}
        for kind in _WORDS:
            if kind in kinds or re.search(_JAPANESE[kind], name):
                return Substance(kind, f"{of} is named {shortened(name, 40)}")
    return None


def _hints_of(document: Document, primitive: Json, node: Substance | None) -> PrimitiveHints:
    materials = document.items("materials")
    number = primitive.get("material", len(materials))
    material: Json = materials[number] if number < len(materials) else {}
    name = material.get("name")
    looks = material.get("pbrMetallicRoughness")
    looks = looks if isinstance(looks, dict) else {}
    # By default a material is metallic, which many files without this key do not mean.
    factor = looks.get("metallicFactor", 0.0)
    metallic = isinstance(factor, int | float) and factor >= _METALLIC and "metallicRoughnessTexture" not in looks
    colour = None if "baseColorTexture" in looks else _coloured(looks.get("baseColorFactor"))
    of_name = named([name], "its material") if isinstance(name, str) else None
    return PrimitiveHints(of_name, bool(metallic), node, colour)


def _coloured(factor: object) -> Substance | None:
    """The substance that a plain colour says; None without one."""
    if not isinstance(factor, list) or len(factor) != 4 or not all(isinstance(x, int | float) for x in factor):
        return None
    red, green, blue = (float(x) for x in factor[:3])
    if not (red > 0.0 and green > 0.0 and blue > 0.0):
        return Substance("cloth", "of its colour")
    skin = _SKIN_RED[0] <= red / green <= _SKIN_RED[1] and _SKIN_GREEN[0] <= green / blue <= _SKIN_GREEN[1]
    return Substance("skin" if skin else "cloth", "of its colour")
