"""The candidates that an artist would wrinkle: not hard parts, nor lips, lids and cheeks.

Lips, lids and nostrils are *rims*, where a surface slides over another and makes no folds.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from wrinklecli.character.bones import read_bones, words_of
from wrinklecli.character.clip import Clip
from wrinklecli.choices import Part
from wrinklecli.errors import AssetError, counted, listed, nearest
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.closest import pairs_within
from wrinklecli.numeric.intersections import sides_of
from wrinklecli.review.suggest.candidates import Candidate, joint_weights
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.place_names import Aspect, NamedBody
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.review.suggest.trial import TriedAsset
from wrinklecli.surface.compression import triangle_weights
from wrinklecli.surface.substance import (
    Substance,
    makeup_of,
    read_hints,
    substance_of,
    substances_at,
)

# Words of joints and morph targets that move what slides, swells or swings: lips and lids, cheeks, tails and ears.
# VRoid's morph targets are `Fcl_MTH_A` and `Fcl_EYE_Close`.
_SLIDING = re.compile(
    r"mouth|mth\b|\blips?\b|jaw|tongue|teeth|tooth|viseme|smile|\beyes?\b(?! ?(brow|squint))|lids?\b|blink|gaze|pupil"
    r"|cheek ?(puff|squint)|breast|bust\b|hair|tail\b|\bears?\b|口|唇|舌|歯|目|瞼|胸|髪|耳|尾"
)
# Greatest distance of a rim over the region's length for a region that lies on the rim.
_NEAR_RIM = 0.8
# Cosine of the normals of two sites that look at each other, at most.
_OPPOSITE = -0.3
# Parts of a body whose joints fold what is around them. Around others it slides, bulges or is stiff: of 64 places there
# that were judged by eye, twice each, 4 % of looks kept one. An upper arm folds a garment, whose field is looked at.
_FOLDING = frozenset(("hips", "spine", "lower arm", "hand", "palm", "upper leg", "lower leg", "toes"))
# The sides on which joints of legs fold the skin: of 47 places on others that were judged by eye, twice each, none was
# kept. Arms hang, or stretch out to the side, so the side of an elbow is called by several names.
_OF_LEGS: Mapping[Part | None, Aspect] = {"upper leg": "front", "lower leg": "back", "toes": "top"}
_OTHER_SIDE = "legs fold in front of the hip, behind the knee and on top of the toes"


def why_unfolded(name: str, *, limb: bool) -> str:
    """Say why an artist wrinkles nothing where a joint or a morph target moves; empty if not."""
    if _SLIDING.search(words_of(name)):
        return "something slides or swells there, such as lips, lids, ears and hair"
    return "" if limb else "no limb folds there, as one does at an elbow or a knee"


def is_limb(part: Part | None, parts: Sequence[Part | None]) -> bool:
    """True for joints of parts that fold.

    Joints of no part, such as hair's and an animal's, fold where no elbow or knee is known. A finger folds where no
    head or knee is: nobody sees one of a whole character.
    """
    others: Mapping[Part | None, tuple[Part, ...]] = {None: ("lower arm", "lower leg"), "finger": ("head", "lower leg")}
    return part in _FOLDING or (part in others and not any(each in parts for each in others[part]))


def folding(document: Document, clips: Sequence[Clip]) -> list[Clip]:
    """Find the motions in a range of motion that fold what an artist wrinkles; each moves a joint or a morph target."""
    names, parts = [str(node.get("name", "")) for node in document.items("nodes")], read_bones(document).parts
    found = []
    for clip in clips:
        ((node, path), *_) = clip.by_target
        by_morph = path == "weights"
        limb = by_morph or is_limb(parts[node], parts)
        if not why_unfolded(clip.name if by_morph else names[node], limb=limb):
            found.append(clip)
    return found


def choose_candidates(
    asset: TriedAsset, candidates: Sequence[Candidate], options: SuggestOptions
) -> tuple[list[Candidate], list[str], list[str]]:
    """Find the materials of candidates, and leave out those that an artist would not wrinkle.

    Returns:
        The other candidates; a line for each material, and for each reason to leave out candidates; and clauses about
        hard parts that were left out, such as "body is metal".

    Raises:
        AssetError: No node, mesh or material has a name in `options.materials`.
    """
    _refuse_unknown(asset.document, options.materials)
    chosen: list[Candidate] = []
    hard: dict[str, None] = {}
    made_of: dict[str, dict[str, Substance]] = {}
    left_out: dict[str, list[str]] = {}
    for each in _judged(asset, candidates, options):
        assert each.substance is not None
        where = each.mesh.rig.node_name
        if each.fault and not options.everything:
            left_out.setdefault(each.fault, []).append(where)
            if each.substance.kind == "hard":
                hard[f"{where} is {each.substance.stiff}"] = None
        else:
            chosen.append(each)
            kinds = made_of.setdefault(where, {})
            known = kinds.setdefault(each.substance.kind, each.substance)
            kinds[each.substance.kind] = max(known, each.substance, key=lambda substance: substance.confidence)
    alike: dict[str, list[str]] = {}
    for where, kinds in made_of.items():
        alike.setdefault("; ".join(substance.words for substance in kinds.values()), []).append(where)
    lines = [f"{listed(meshes)}: {words}" for words, meshes in alike.items()]
    lines += [
        f"{listed(dict.fromkeys(meshes))}: left out {counted(len(meshes), 'fold')}, as {why}; --all takes all"
        for why, meshes in left_out.items()
    ]
    unread = dict.fromkeys(note for each in candidates for note in asset.ground(each.mesh.rig.node).pictures.notes)
    return chosen, [*unread, *lines], [*hard]


def _refuse_unknown(document: Document, names: Iterable[str]) -> None:
    """Raise AssetError for a name that no node with a mesh, no mesh and no material has."""
    nodes = [node for node in document.items("nodes") if "mesh" in node]
    items = [*document.items("materials"), *nodes, *document.items("meshes")]
    known = list(dict.fromkeys(str(item["name"]) for item in items if "name" in item))
    for name in names:
        if name not in known:
            fault = (
                f"{name!r} is no material, node with a mesh, or mesh{nearest(name, known)}; there are {listed(known)}"
            )
            raise AssetError(fault, where=document.path)


def _judged(asset: TriedAsset, candidates: Sequence[Candidate], options: SuggestOptions) -> Iterator[Candidate]:
    """Give candidates their materials and faults."""
    body, known = NamedBody.of(asset.document), options.known_presets
    parts = body.bones.parts
    # Of nodes with one name the first counts.
    numbers = {name: number for number, name in reversed([*enumerate(body.hierarchy.names)])}
    distinct = {id(each.mesh.gauge.surface): each.mesh for each in candidates}
    makeups = {key: makeup_of(asset.ground(mesh.rig.node), mesh.gauge) for key, mesh in distinct.items()}
    # What a texture's alpha cuts away, as at a ragged hem, is of no substance.
    shown = {key: each.shown for key, each in makeups.items()}
    rims = cache(lambda surface: rims_of(distinct[surface]))
    for each in candidates:
        mesh, surface = each.mesh, id(each.mesh.gauge.surface)
        # Animals are neither shod nor dressed, and their coats have several colours.
        animal = makeups[surface].animal
        # Joints of an animal are of no part: of 7 places on a zebra that were judged by eye, twice each, none was kept.
        part = None if each.by_morph or animal else parts[numbers[each.driver]]
        place = part and body.place(numbers[each.driver], part, each.region.normal, each.region.centre)
        # Instances share a surface, but the names of their nodes may say what each is made of.
        hints = read_hints(asset.document, mesh.rig, options.materials, animal=animal)
        makeup = replace(makeups[surface], hints=hints)
        weights = np.maximum(triangle_weights(mesh.sites, each.region), 0.0)
        substance = substance_of(makeup, weights, part, by_morph=each.by_morph)
        # Lips and brows are painted on one skin.
        kinds = substances_at(asset.ground(mesh.rig.node))[mesh.gauge.numbers]
        of_kinds = [math.nan] if each.by_morph else np.bincount(kinds, weights * shown[surface])
        limb = each.by_morph or is_limb(part, parts)
        on_side = place is None or place.aspect == _OF_LEGS.get(part, place.aspect)
        fault = why_unfolded(each.driver, limb=limb) if on_side else _OTHER_SIDE
        bare = makeup.bare
        if substance.is_guess and bare is not None and not bare.everywhere:
            fault = "its colour is not that of the bare skin, and nothing says what it is made of"
        fault = substance.fault if substance.kind == "hard" else fault
        # A morph target that moves an arm or a leg is another build of the body, and no motion.
        if each.by_morph and parts[mesh.rig.joints[joint_weights(mesh, each.region).argmax()]] in _FOLDING:
            fault = "its morph target shapes a limb, which only joints fold"
        if not fault and each.by_morph:
            from_rim = np.linalg.norm(rims(surface) - each.region.centre, axis=1).min(initial=math.inf)
            fault = "it is a rim, such as of lips or lids" if from_rim < _NEAR_RIM * each.region.length else ""
        uniform = float(np.max(of_kinds) / weights.sum())
        yield replace(each, part=part, place=place, substance=substance, uniform=uniform, presets=known, fault=fault)


def rims_of(mesh: MeasuredMesh) -> Floats:
    """(points, 3) where the surface ends, or looks at itself within two neighbourhoods' radii."""
    sites, triangles = mesh.sites, mesh.gauge.triangles
    # One number for each pair of vertices, as rows take ten times as long to sort.
    distinct, counts = np.unique(sides_of(triangles) @ [len(mesh.rest.positions), 1], return_counts=True)
    ends = mesh.rest.positions[np.unique(np.divmod(distinct[counts == 1], len(mesh.rest.positions)))]
    pairs = pairs_within(sites.positions, 2.0 * sites.radius)
    first, second = pairs.T
    between = sites.positions[second] - sites.positions[first]
    facing = np.sum(sites.normals[first] * sites.normals[second], axis=1) < _OPPOSITE
    facing &= np.sum(between * sites.normals[first], axis=1) > 0
    facing &= np.sum(between * sites.normals[second], axis=1) < 0
    return np.concatenate([ends, sites.positions[np.unique(pairs[facing])]])
