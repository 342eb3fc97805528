"""Garments: meshes, or parts of them, that look like cloth. Each gets a field, which is tried and judged as tools are.

A field lies on cloth alone, and the joints of the trunk and of limbs fold it: collars, gloves and shoes fold otherwise.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrinklecli.baking.split import grown_bytes, planned_bytes
from wrinklecli.character.bent import bending_nodes
from wrinklecli.character.bones import read_bones, words_of
from wrinklecli.character.clip import Clip
from wrinklecli.character.paints import texture_info
from wrinklecli.choices import SUBSTANCES, MaterialName
from wrinklecli.choices import Part as PartOfBody
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import attach_effects, plan_on, sketch
from wrinklecli.effects.sampling import seen_at
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.score import Score, left_out_without_all, mean_of
from wrinklecli.review.suggest.stage import Placement
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.review.suggest.text import Entry
from wrinklecli.review.suggest.trial import MOST_LEVELS, TriedAsset
from wrinklecli.review.suggest.worth import Dropped, frames_of, look_in
from wrinklecli.surface.sites import Peaks
from wrinklecli.surface.substance import WORDS, PrimitiveHints, is_rigid, read_hints, substances_at
from wrinklecli.tools.fields import Field
from wrinklecli.tools.mirror import exchange_sides, numbered
from wrinklecli.tools.records import ONE_PERCENT, RefinementSettings, ToolsFile
from wrinklecli.tools.yaml_tree import printable

_CLOTH: MaterialName = "cloth"
# Part of a mesh's area that has to be cloth for a field, and from which on all of it is.
_SOME, _ALL = 0.1, 0.97
# Parts of a body whose joints fold no garment: a neck moves within a collar; the folds of gloves and shoes are tools'.
_APART: tuple[PartOfBody, ...] = ("neck", "head", "jaw", "eye", "hand", "palm", "finger", "foot", "toes")
# Part of the largest area that a joint bends below which it folds nothing.
LEAST_BENT = 0.02
# Moments of the tallest folds at which a field is looked at. By two, a shirt is lost of which a sleeve hides one.
_LOOKS = 3
# Part of the budget for fields: the rest is for tools, and as edges are halved as a whole.
_OF_FIELDS = 0.9
# Most that folds are widened to take less memory: they still look like those of the material.
_WIDEST = 1.5
# Part of the surface round a place from which on the place lies on a garment, whose field wrinkles it.
_MOSTLY = 0.5


@dataclass(frozen=True, slots=True)
class SuggestedField:
    """A field over a garment.

    Attributes:
        field: Its definition, as it is written.
        mesh: Name of the node.
        why: What of the mesh is cloth, in words.
        clip: Name of the clip that folds it most.
        time: The time of the tallest fold in this clip, seconds.
        height: The height of that fold, scene units.
        wavelength: From crest to crest, scene units.
        targets: The number of its morph targets.
        gpu_bytes: What they take at most on a GPU where each part of the mesh has those that move it.
        own_bytes: What the mesh's own targets take there for the vertices that it adds.
        levels: How often edges are halved for it.
        judgement: What one sees of it at its tallest folds, as a score.
    """

    field: Field
    mesh: str
    why: str
    clip: str
    time: float
    height: float
    wavelength: float
    targets: int
    gpu_bytes: int
    own_bytes: int
    levels: int
    judgement: Score

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


@dataclass(frozen=True, slots=True)
class Garment:
    """A mesh of which something is cloth, and the field to try.

    Attributes:
        mesh: The mesh.
        field: Without a strength.
        why: What of the mesh is cloth, in words.
        cloth: (triangles,) 1 for those of the gauge that the field lies on, else 0.
    """

    mesh: MeasuredMesh
    field: Field
    why: str
    cloth: Floats

    def widened(self, factor: float) -> "Garment":
        """The garment with folds that are wider by a factor."""
        length = self.field.wavelength
        wider = replace(length, value=round(length.value * factor, 1))
        return replace(self, field=replace(self.field, wavelength=wider))


def find_garments(asset: TriedAsset, meshes: Sequence[MeasuredMesh], options: SuggestOptions) -> list[Garment]:
    """Find the garments among meshes; of instances the first one counts."""
    garments: list[Garment] = []
    parts = read_bones(asset.document).parts
    for number, mesh in enumerate(meshes):
        if all(mesh.gauge.surface is not other.gauge.surface for other in meshes[:number]):
            found = _garment(asset, mesh, parts, [each.field.name for each in garments], options)
            garments += [] if found is None else [found]
    return garments


def _garment(
    asset: TriedAsset,
    mesh: MeasuredMesh,
    parts: Sequence[PartOfBody | None],
    taken: Sequence[str],
    options: SuggestOptions,
) -> Garment | None:
    """The field of a mesh; None if hardly anything of it is cloth, or if no joint folds it."""
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
    if not joints or float(gauge.areas @ folded) < _SOME * float(gauge.areas.sum()):
        return None
    kinds = substances_at(asset.ground(rig.node))[gauge.numbers]
    # A garment that is named so is one as a whole, whatever colours it has.
    named = np.array([each.material is not None and each.material.kind == _CLOTH for each in hints])[primitives]
    kinds[named & (kinds != SUBSTANCES.index("hard"))] = SUBSTANCES.index(_CLOTH)
    asked = np.array([-1 if each.asked is None else SUBSTANCES.index(each.asked.kind) for each in hints])[primitives]
    kinds = np.where(asked < 0, kinds, asked)
    cloth = ((kinds == SUBSTANCES.index(_CLOTH)) & folded).astype(np.float64)
    share = float(gauge.areas @ cloth / gauge.areas.sum())
    if share < _SOME:
        return None
    whole = share > _ALL or bool((asked == SUBSTANCES.index(_CLOTH)).all())
    stem = _name_of([rig.node_name, str(document.items("meshes")[rig.mesh].get("name", ""))])
    values = {
        "name": numbered(stem, taken) if stem in taken else stem,
        "node": mesh.node,
        "substance": None if whole else (_CLOTH,),
        "material": _CLOTH,
        "joints": "all" if len(joints) == len(bending) else tuple(joints),
    }
    return Garment(
        mesh,
        Field(**Field.fields_of(values, {})),
        f"{'all' if whole else f'{100 * share:.0f} %'} of it looks like cloth",
        np.ones_like(cloth) if whole else cloth,
    )


def _is_told(document: Document, mesh: int, primitive: int, hints: PrimitiveHints) -> bool:
    """True if a picture, a name or the user says what a primitive is made of: a plain colour may be anything's."""
    if any(each is not None for each in (hints.asked, hints.material, hints.node)):
        return True
    shown = document.items("meshes")[mesh]["primitives"][primitive]
    return "COLOR_0" in shown["attributes"] or bool(texture_info(document, shown, "baseColorTexture"))


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
            on = mesh.sites.gather @ cloth[id(mesh.gauge.surface)] > _MOSTLY
            found[id(peaks)] = replace(peaks, losses=np.where(on, 0.0, peaks.losses))
    return [(mesh, found[id(peaks)]) for mesh, peaks in meshes]


def suggest_fields(
    asset: TriedAsset,
    garments: Sequence[Garment],
    clips: Sequence[Clip],
    budget: float,
    progress: Progress,
    *,
    everything: bool,
) -> tuple[list[SuggestedField], list[Dropped]]:
    """Try a field on each garment in clips; give those that are worth it, and the others, each with the reason.

    The budget is bytes on a GPU. What a field takes is known before the mesh carries it, which takes longest. Where all
    take too much, folds are as much wider: those need fewer vertices. With `everything` all are kept that can be baked.
    """
    drafts, dropped = _drafts(asset, garments)
    over = sum(each.gpu_bytes for each in drafts) / (_OF_FIELDS * budget)
    if over > 1.0:
        drafts, dropped = _drafts(asset, [each.widened(min(over, _WIDEST)) for each in garments])
    fitting = list[_Draft]()
    for made in drafts:
        if made.gpu_bytes > budget:
            where = made.garment.mesh.rig.node_name
            dropped.append(Dropped.costly(made.garment.field.name, where, made.gpu_bytes))
        else:
            budget -= made.gpu_bytes
            fitting.append(made)
    tried = list[SuggestedField]()
    for step, found in enumerate(in_processes(partial(_judged, asset, clips), fitting, asset.jobs), 1):
        progress("fields", step, len(fitting))
        if isinstance(found, Dropped):
            dropped.append(found)
        else:
            tried.append(found)
    fields = list[SuggestedField]()
    by_mesh = {each.mesh: each for each in tried}
    for each in tried:
        # A sleeve alone looks like a fault, so left and right are judged together.
        pair = each, by_mesh.get(exchange_sides(each.mesh), each)
        score = Score.of(mean_of([one.judgement.merits for one in pair]))
        if score.is_kept or everything:
            fields.append(replace(each, judgement=score))
        else:
            dropped.append(Dropped(each.field.name, each.mesh, *score.reason))
    return fields, dropped


def _drafts(asset: TriedAsset, garments: Sequence[Garment]) -> "tuple[list[_Draft], list[Dropped]]":
    """The drafts of fields, and those that a bake would refuse."""
    drafts, dropped = list[_Draft](), list[Dropped]()
    for each in garments:
        try:
            drafts.append(_Draft.of(asset, each))
        except WrinkleError as error:
            where = each.mesh.rig.node_name
            dropped.append(Dropped(each.field.name, where, "refused", 0.0, error.lines[0]))
    return drafts, dropped


@dataclass(frozen=True, slots=True)
class _Draft:
    """A field attached to its mesh, and the mesh as a bake refines it, before that carries the field.

    Attributes:
        garment: The garment, with the field.
        attached: The field.
        refined: The refined mesh.
        gpu_bytes: What the targets of the field take at most.
    """

    garment: Garment
    attached: AnyAttached
    refined: MeshPlan
    gpu_bytes: int

    @classmethod
    def of(cls, asset: TriedAsset, garment: Garment) -> "_Draft":
        """Attach the field of a garment, and refine the mesh for it.

        Raises:
            WrinkleError: A bake would refuse it.
        """
        # No edge is halved more often than it has to be.
        settings = ToolsFile(path=asset.document.path, refinement=RefinementSettings(max_levels=MOST_LEVELS))
        ground, (attached,) = attach_effects(asset.ground(garment.mesh.rig.node), [garment.field], settings)
        refined = plan_on(ground, [attached], settings, ONE_PERCENT, carried=False)
        return cls(garment, attached, refined, planned_bytes(refined, attached.may_move(refined.fine)))


def _judged(asset: TriedAsset, clips: Sequence[Clip], draft: _Draft) -> SuggestedField | Dropped:
    """A field with its score, or the reason why there is none.

    It is looked at before a bake lowers it where it turns triangles over, which takes longest and always succeeds.
    """
    field, plan = draft.garment.field, draft.refined
    where = plan.rig.node_name
    dropped = partial(Dropped, field.name, where)
    try:
        part = sketch(draft.attached, 0, plan.fine, np.zeros(0, np.bool_))
    except WrinkleError as error:
        return dropped("refused", 0.0, error.lines[0])
    assert part is not None, "a field moves the skin"
    moving = [clip for clip in clips if not clip.nodes.isdisjoint(part.drive.nodes)]
    if not moving:
        return dropped("not raised", 0.0)
    seen = [seen_at(part, plan.rig, clip, frames_of(clip, plan.rig)) for clip in moving]
    warnings = part.words(plan).warnings(plan, seen, up="y")
    if plan.fine.subdivision.limited:
        warnings.append(f"{plan.fine.subdivision.limited} edges stay too long for it at max_levels {MOST_LEVELS}")
    if warnings:
        return dropped("warned", 0.0, warnings[0])
    # Each shape where it is tallest, the tallest of all first.
    heights = np.stack([each.weights.max(axis=0) for each in seen]) * part.sizes(plan.fine)
    moments: dict[tuple[str, float], None] = {}
    for shape in np.argsort(-heights.max(axis=0), kind="stable").tolist():
        tallest = seen[int(heights[:, shape].argmax())]
        time = float(tallest.motion.times[int(tallest.weights[:, shape].argmax())])
        moments[tallest.motion.clip.name, time] = None
    placement = Placement(plan, part)
    looks = [look_in(asset, placement, *moment, limb=False) for moment in list(moments)[:_LOOKS]]
    raised = [each for each in looks if each is not None]
    if not raised:
        return dropped("not raised", 0.0)
    clip, time = next(iter(moments))
    return SuggestedField(
        field=field,
        mesh=where,
        why=draft.garment.why,
        clip=clip,
        time=time,
        height=float(heights.max()),
        wavelength=part.attached.bump_width,
        targets=len(part.drive.targets),
        gpu_bytes=draft.gpu_bytes,
        own_bytes=grown_bytes(plan),
        levels=plan.fine.subdivision.levels,
        judgement=Score.of(mean_of([score.merits for score, _ in raised])),
    )
