"""Garments: meshes, or parts of them, that look like cloth. Each gets a field, which is tried and judged as tools are.

A field lies on cloth alone, and the joints of the trunk and of limbs fold it: collars, gloves and shoes fold otherwise.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrinklecli.character.bent import bending_nodes
from wrinklecli.character.bones import grown, read_bones, words_of
from wrinklecli.character.paints import texture_info
from wrinklecli.character.rig import read_hierarchy
from wrinklecli.choices import SUBSTANCES, MaterialName
from wrinklecli.choices import Part as PartOfBody
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.score import left_out_without_all
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.review.suggest.text import Entry
from wrinklecli.review.suggest.trial import Suggested, TriedAsset
from wrinklecli.review.suggest.worth import Draft, Dropped, Judge, Worthwhile
from wrinklecli.surface.sites import Peaks
from wrinklecli.surface.substance import WORDS, PrimitiveHints, is_rigid, read_hints, substances_at
from wrinklecli.tools.fields import Field
from wrinklecli.tools.mirror import exchange_sides, numbered
from wrinklecli.tools.records import RefinementSettings
from wrinklecli.tools.yaml_tree import printable

_CLOTH: MaterialName = "cloth"
# Part of the largest mesh's area that has to be cloth for a field: a tie or a sock is less. Part of a mesh's area from
# which on all of it is cloth.
_SOME, _ALL = 0.1, 0.97
# Parts of a body whose joints fold no garment: a neck moves within a collar; the folds of gloves and shoes are tools'.
_APART: tuple[PartOfBody, ...] = ("neck", "head", "jaw", "eye", "hand", "palm", "finger", "foot", "toes")
# Part of the largest area that a joint bends below which it folds nothing.
LEAST_BENT = 0.02
# Part of the budget for fields: the rest is for tools, and as edges are halved as a whole.
_OF_FIELDS = 0.9
# Most that folds are widened to take less memory: they still look like those of the material.
_WIDEST = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class SuggestedField(Suggested):
    """A field over a garment.

    Attributes:
        field: Its definition, as it is written.
        why: What of the mesh is cloth, in words.
    """

    field: Field
    why: str

    @property
    def effect(self) -> Field:
        """The field."""
        return self.field

    @property
    def entry(self) -> Entry:
        """The field as the file has it."""
        remarks = [
            f"{self.why}: folds are {self.wavelength:.3g} from crest to crest, and up to {self.height:.2g} high in clip"
            f" {printable(self.clip, 50)} at {self.time:.2f} s",
            f"{counted(self.targets, 'morph target')}, {self.gpu_bytes / 1e6:.1f} MB on a GPU after bake --split",
            *left_out_without_all(self.judgement),
        ]
        return Entry(self.field, remarks=remarks)

    def widened(self, factor: float) -> "SuggestedField":
        """The same with folds that are wider by a factor."""
        length = self.field.wavelength
        wider = replace(length, value=round(length.value * factor, 1))
        return replace(self, field=replace(self.field, wavelength=wider))


@dataclass(frozen=True, slots=True)
class Garment:
    """A mesh of which something is cloth, and the field to try.

    Attributes:
        mesh: The mesh.
        suggestion: The field, before anybody looks at it.
        cloth: (triangles,) 1 for those of the gauge that the field lies on, else 0.
    """

    mesh: MeasuredMesh
    suggestion: SuggestedField
    cloth: Floats


def find_garments(asset: TriedAsset, meshes: Sequence[MeasuredMesh], options: SuggestOptions) -> list[Garment]:
    """Find the garments among meshes; of instances the first one counts."""
    garments: list[Garment] = []
    own, hierarchy = read_bones(asset.document).parts, read_hierarchy(asset.document)
    # A joint of no part, such as hair's, moves with the part above it.
    parts = [next((own[k] for k in hierarchy.upwards(node) if own[k]), None) for node in range(len(own))]
    least = _SOME * max((float(mesh.gauge.areas.sum()) for mesh in meshes), default=0.0)
    for number, mesh in enumerate(meshes):
        if all(mesh.gauge.surface is not other.gauge.surface for other in meshes[:number]):
            found = _garment(asset, mesh, parts, [each.suggestion.field.name for each in garments], options, least)
            garments += [] if found is None else [found]
    return garments


def _garment(
    asset: TriedAsset,
    mesh: MeasuredMesh,
    parts: Sequence[PartOfBody | None],
    taken: Sequence[str],
    options: SuggestOptions,
    least: float,
) -> Garment | None:
    """The field of a mesh; None if less than an area of it is cloth, or if no joint folds it."""
    gauge, rig, document = mesh.gauge, mesh.rig, asset.document
    if not rig.skinned or is_rigid(gauge):
        return None
    primitives = gauge.surface.primitives[gauge.numbers]
    hints = read_hints(document, rig, options.materials)
    told = np.array([_is_told(document, rig.mesh, number, each) for number, each in enumerate(hints)])[primitives]
    apart = np.array([parts[joint] in _APART for joint in rig.joints.tolist()])[gauge.surface.heaviest]
    folded = told & ~apart[gauge.triangles].all(axis=1)
    bending = bending_nodes(document, rig, LEAST_BENT)
    joints = [rig.names[node] for node in bending if parts[node] not in _APART]
    # What it is made of takes longest to find.
    if not joints or float(gauge.areas @ folded) < least:
        return None
    kinds = substances_at(asset.ground(rig.node))[gauge.numbers]
    # A garment that is named so is one as a whole, whatever colours it has.
    named = np.array([each.material is not None and each.material.kind == _CLOTH for each in hints])[primitives]
    asked = np.array([-1 if each.asked is None else SUBSTANCES.index(each.asked.kind) for each in hints])[primitives]
    is_cloth = (kinds == SUBSTANCES.index(_CLOTH)) | (named & (kinds != SUBSTANCES.index("hard")))
    cloth = (np.where(asked < 0, is_cloth, asked == SUBSTANCES.index(_CLOTH)) & folded).astype(np.float64)
    if float(gauge.areas @ cloth) < least:
        return None
    share = float(gauge.areas @ cloth / gauge.areas.sum())
    whole = share > _ALL or bool((asked == SUBSTANCES.index(_CLOTH)).all())
    stem = _name_of([rig.node_name, str(document.items("meshes")[rig.mesh].get("name", ""))])
    values = {
        "name": numbered(stem, taken) if stem in taken else stem,
        "node": mesh.node,
        "substance": None if whole else (_CLOTH,),
        "material": _CLOTH,
        "joints": "all" if len(joints) == len(bending) else tuple(joints),
    }
    field = SuggestedField(
        field=Field(**Field.fields_of(values, {})),
        mesh=rig.node_name,
        grown=grown(document, rig, asset.scene),
        why=f"{'all' if whole else f'{100 * share:.0f} %'} of it looks like cloth",
    )
    return Garment(mesh, field, np.ones_like(cloth) if whole else cloth)


def _is_told(document: Document, mesh: int, primitive: int, hints: PrimitiveHints) -> bool:
    """True if a picture, a name or the user says what a primitive is made of: a plain colour may be anything's."""
    said = any(each is not None for each in (hints.asked, hints.material, hints.node))
    shown = document.items("meshes")[mesh]["primitives"][primitive]
    return said or "COLOR_0" in shown["attributes"] or bool(texture_info(document, shown, "baseColorTexture"))


def _name_of(names: Sequence[str]) -> str:
    """The last word for a garment in the name of a node, or else of its mesh; `clothes` if there is none."""
    known = WORDS[_CLOTH].split()
    words = [word for name in names[::-1] for word in words_of(name).split()]
    return next((word for word in words[::-1] if word in known or word.removesuffix("s") in known), "clothes")


def beside_garments(
    meshes: Sequence[tuple[MeasuredMesh, Peaks]], garments: Sequence[Garment]
) -> list[tuple[MeasuredMesh, Peaks]]:
    """Leave out what clips compress of garments, from the peaks of meshes that may have some."""
    cloth = {id(each.mesh.gauge.surface): each.cloth for each in garments}
    found = {id(peaks): peaks for _, peaks in meshes}
    for mesh, peaks in meshes:
        if id(mesh.gauge.surface) in cloth:
            # The field wrinkles a place round which most of the surface is the garment's.
            on = mesh.sites.gather @ cloth[id(mesh.gauge.surface)] > 0.5
            found[id(peaks)] = replace(peaks, losses=np.where(on, 0.0, peaks.losses))
    return [(mesh, found[id(peaks)]) for mesh, peaks in meshes]


def suggest_fields(judge: Judge, garments: Sequence[Garment], budget: float) -> Worthwhile[SuggestedField]:
    """Try a field on each garment; give those that are worth it, and the others, each with the reason.

    The budget is bytes on a GPU. Where all take too much, folds are as much wider: those need fewer vertices.
    """
    fields, least = [each.suggestion for each in garments], RefinementSettings()
    drafts = _drafts(judge, least, fields)
    over = sum(each.cost for each in drafts.values() if isinstance(each, Draft)) / (_OF_FIELDS * budget)
    if over > 1.0 and not judge.everything:
        fields = [each.widened(min(over, _WIDEST)) for each in fields]
        drafts = _drafts(judge, least, fields)
    found = judge.worthwhile(fields, least, count=len(fields), budget=budget, drafts=drafts)
    # A sleeve alone looks like a fault.
    left_out = {each.mesh: each for each in found.dropped}
    for each in found.kept:
        if (other := left_out.get(exchange_sides(each.mesh))) is not None:
            found.dropped.append(replace(other, name=each.field.name, mesh=each.mesh))
    kept = [each for each in found.kept if all(other.name != each.field.name for other in found.dropped)]
    return replace(found, kept=kept)


def _drafts(judge: Judge, least: RefinementSettings, fields: Sequence[SuggestedField]) -> dict[str, Dropped | Draft]:
    """Attach fields, and refine their meshes, which takes most of the time; by their names."""
    found = in_processes(partial(judge.drafted, least), fields, judge.asset.jobs, shared=judge.asset.shared)
    return dict(zip((each.field.name for each in fields), found, strict=True))
