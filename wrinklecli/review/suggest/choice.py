"""Which folds an artist would wrinkle: not hard parts, nor what another layer hides, nor lips, lids and cheeks."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from wrinklecli.character.bones import Part, read_bones, words_of
from wrinklecli.character.scene import read_scene
from wrinklecli.errors import counted
from wrinklecli.gltf.document import Document
from wrinklecli.review.suggest.cover import is_covered, layers_over
from wrinklecli.review.suggest.folds import Fold
from wrinklecli.review.suggest.openings import is_rim, rims
from wrinklecli.review.suggest.substance import is_faceted, read_makeup, substance_of
from wrinklecli.surface.compression import triangle_shares
from wrinklecli.tools.mirror import split_side

# What a joint or a morph target of these words moves gets no wrinkles of ours: lips and lids slide, cheeks swell, tails
# and ears swing. VRoid's morph targets are `Fcl_MTH_A` and `Fcl_EYE_Close`.
_SLIDING = re.compile(
    r"mouth|mth\b|\blips?\b|jaw|tongue|teeth|tooth|viseme|smile|\beyes?\b(?! ?(brow|squint))|lids?\b|blink|gaze|pupil"
    r"|cheek ?puff|breast|bust\b|hair|tail\b|\bears?\b|口|唇|舌|歯|目|瞼|胸|髪|耳|尾"
)
# Joints of the trunk under which bare skin is held by ribs and shoulder blades; clothes there fold.
_BONY: tuple[Part, ...] = ("chest", "shoulder")


@dataclass(frozen=True, slots=True)
class Choice:
    """Folds that deserve tools.

    Attributes:
        folds: Each with its driver and its material.
        notes: What they are made of and what was left out, a line each.
    """

    folds: tuple[Fold, ...]
    notes: tuple[str, ...]


def choose_folds(document: Document, folds: Sequence[Fold], *, everything: bool = False) -> Choice:
    """Tell of what folds are made, and leave out those that an artist would not wrinkle.

    Args:
        document: The asset.
        folds: Of all its meshes.
        everything: Leave out none.
    """
    scene = () if everything else read_scene(document, leave_out_malformed=True)
    chosen: list[Fold] = []
    notes: Counter[str] = Counter()
    left_out: Counter[tuple[str, str]] = Counter()
    known = {}
    bones = read_bones(document)
    for fold in folds:
        mesh = fold.mesh
        part = None if fold.by_morph else bones.parts[mesh.rig.names.index(fold.driver)]
        if id(mesh) not in known:
            known[id(mesh)] = read_makeup(document, mesh.rig, mesh.gauge), layers_over(mesh, scene), rims(mesh)
        makeup, layers, edges = known[id(mesh)]
        where = mesh.rig.names[mesh.rig.node]
        shares = triangle_shares(mesh.sites, fold.region)
        substance = substance_of(makeup, shares)
        if substance.kind == "hard" and not everything:
            left_out[where, f"hard, as {substance.why}"] += 1
        elif not everything and _SLIDING.search(words_of(fold.driver)):
            left_out[where, f"where {split_side(fold.driver)[0] or fold.driver} moves, which slides or swells"] += 1
        elif not everything and substance.kind == "skin" and part in _BONY:
            left_out[where, "over ribs, which hold the skin"] += 1
        elif not everything and fold.by_morph and is_rim(fold.region, edges):
            left_out[where, "at a rim, such as of lips or lids"] += 1
        elif not everything and is_covered(layers, shares, fold.clip, fold.time):
            left_out[where, "under another layer where it folds"] += 1
        else:
            material = None if substance.kind == "hard" else substance.kind
            # The edges of an equilateral triangle in the ball round each.
            facet = 3.0**0.5 * float(shares @ mesh.gauge.radii) if is_faceted(makeup, shares) else 0.0
            chosen.append(replace(fold, material=material, facet=facet, part=part))
            notes[f"{where}: {substance.kind}, as {substance.why}"] += 1
    lines = [
        f"{where}: left out {counted(count, 'fold')}: {why}; --all takes all"
        for (where, why), count in left_out.items()
    ]
    return Choice(tuple(chosen), (*notes, *lines))
