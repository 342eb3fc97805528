"""The candidates that an artist would wrinkle: not hard parts, nor what another layer hides, nor lips, lids and cheeks.

Lips, lids and nostrils are *rims*, where a surface slides over another and makes no folds.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import Part, read_bones, words_of
from wrinklecli.character.scene import read_scene
from wrinklecli.errors import counted
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.intersections import sides_of
from wrinklecli.numeric.nearest import pairs_within
from wrinklecli.review.suggest.candidates import Candidate
from wrinklecli.review.suggest.cover import is_covered
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.substance import facet_length, read_makeup, substance_of
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.surface.compression import CompressedRegion, triangle_weights
from wrinklecli.tools.mirror import split_side

# Words of joints and morph targets that move what slides, swells or swings: lips and lids, cheeks, tails and ears.
# VRoid's morph targets are `Fcl_MTH_A` and `Fcl_EYE_Close`.
_SLIDING = re.compile(
    r"mouth|mth\b|\blips?\b|jaw|tongue|teeth|tooth|viseme|smile|\beyes?\b(?! ?(brow|squint))|lids?\b|blink|gaze|pupil"
    r"|cheek ?puff|breast|bust\b|hair|tail\b|\bears?\b|口|唇|舌|歯|目|瞼|胸|髪|耳|尾"
)
# Joints of the trunk, where ribs and shoulder blades hold bare skin; clothes fold there.
_BONY: tuple[Part, ...] = ("chest", "shoulder")
# Greatest distance of a rim over the region's length for a region that lies on the rim.
_NEAR_RIM = 0.8
# Cosine of the normals of two sites that look at each other, at most.
_OPPOSITE = -0.3


def choose_candidates(
    document: Document, candidates: Sequence[Candidate], options: SuggestOptions
) -> tuple[list[Candidate], list[str]]:
    """Find the materials of candidates, and leave out those that an artist would not wrinkle.

    Returns:
        The other candidates; and a line for each material, and for each reason to leave out candidates.
    """
    everything = options.everything
    scene = () if everything else read_scene(document, leave_out_malformed=True)
    chosen: list[Candidate] = []
    notes: Counter[str] = Counter()
    left_out: Counter[tuple[str, str]] = Counter()
    known = {}
    bones = read_bones(document)
    for each in candidates:
        mesh = each.mesh
        part = None if each.by_morph else bones.parts[mesh.rig.names.index(each.driver)]
        if id(mesh) not in known:
            known[id(mesh)] = read_makeup(document, mesh.rig, mesh.gauge), _rims(mesh)
        makeup, rims = known[id(mesh)]
        where = mesh.rig.names[mesh.rig.node]
        weights = triangle_weights(mesh.sites, each.region)
        substance = substance_of(makeup, weights)
        if substance.kind == "hard" and not everything:
            left_out[where, f"hard, as {substance.why}"] += 1
        elif not everything and _SLIDING.search(words_of(each.driver)):
            left_out[where, f"where {split_side(each.driver)[0] or each.driver} moves, which slides or swells"] += 1
        elif not everything and substance.kind == "skin" and part in _BONY:
            left_out[where, "over ribs, which hold the skin"] += 1
        elif not everything and each.by_morph and _is_rim(each.region, rims):
            left_out[where, "at a rim, such as of lips or lids"] += 1
        elif not everything and is_covered(mesh, scene, weights, each.clip, each.time):
            left_out[where, "under another layer where it folds"] += 1
        else:
            facet = facet_length(makeup, weights)
            chosen.append(replace(each, material=substance.material, facet=facet, part=part))
            notes[f"{where}: {substance.kind}, as {substance.why}"] += 1
    lines = [
        f"{where}: left out {counted(count, 'fold')}: {why}; --all takes all"
        for (where, why), count in left_out.items()
    ]
    return chosen, [*notes, *lines]


def _rims(mesh: MeasuredMesh) -> Floats:
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


def _is_rim(region: CompressedRegion, rims: Floats) -> bool:
    """True if a region lies on one of the (points, 3) of rims."""
    if not len(rims):
        return False
    nearest = float(np.sqrt(np.min(np.sum((rims - region.centre) ** 2, axis=1))))
    return nearest < _NEAR_RIM * region.length
