"""The tools on one mesh, attached and refined: what follows from mesh and tools alone, whichever clips are baked."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.baking.job import Job
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours, contacts_of
from wrinklecli.character.obstacles import read_obstacles
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.surface import Surface, influence_count, read_surface
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.carry import CarriedPatch, carry
from wrinklecli.effects.wrinkle.demand import demanding
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.errors import AssetError, BakeError, WrinkleError, listed, nearest
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, Ints, determinants, distinct_values, median
from wrinklecli.numeric.memory import MAX_VERTICES
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.surface.rest import Rest, rest_pose
from wrinklecli.tools.records import Length, ToolsFile, WrinkleTool

if TYPE_CHECKING:
    from wrinklecli.effects.contact.fold import Fold

# Products of skinning round a few times; below this many units in the last place float32 sets the limit.
_FLOAT32_STEPS = 8
# Poses of a clip at which pruned skin weights are judged before the proof.
_POSES = 33
# Fewer where these matrices of all clips and joints would take more than half a gigabyte.
_MOST_MATRICES = 2**22
# Share of the error bound for pruned skin weights; heights between keys have the rest: see `sample`.
_PRUNING_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class MeshPlan:
    """The tools on one node's mesh, attached and refined: everything but time.

    Attributes:
        rig: Of the node.
        rest: The rest pose.
        fine: The refined surface.
        carried_patches: The tools, on the refined surface.
        tallest: Height of the tallest wrinkle that the tools can make, scene units.
        max_error: Scene units.
        scale: World over bind units, at rest.
        has_normals: Whether the mesh has NORMALs, so that shapes need them too.
        folds: Where contact is resolved.
        unhinged: Numbers of the tools whose contact is to be resolved, but whose ends nothing brings together.
    """

    rig: Rig
    rest: Rest
    fine: Refinement
    carried_patches: tuple[CarriedPatch, ...]
    tallest: float
    max_error: float
    scale: float
    has_normals: bool
    folds: tuple["Fold", ...] = ()
    unhinged: tuple[int, ...] = ()


def plan_meshes(job: Job, *, influences: int | None = None) -> list[MeshPlan]:
    """Attach the tools of every mesh and refine it, as `plan_mesh` does.

    Args:
        job: The asset and its tools.
        influences: Of a new vertex, at most; those of the asset where left out.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    plans: list[MeshPlan] = []
    problems: list[WrinkleError] = []
    neighbours = Neighbours(job.document)
    for node, tools in job.by_node.items():
        try:
            plan = plan_mesh(
                job.document,
                node,
                tools,
                job.settings,
                job.every_clip,
                job.options.max_error,
                influences=influences,
                max_vertices=job.options.max_vertices,
                neighbours=neighbours,
            )
        except WrinkleError as error:
            problems.append(error)
        else:
            plans.append(plan)
    if problems:
        # What is wrong with the whole file is wrong with each mesh.
        raise problems[0] if len({str(each) for each in problems}) == 1 else BakeError.of_all(problems)
    return plans


@dataclass(frozen=True, eq=False)
class Ground:
    """A node's mesh at rest, before tools are on it: what many plans for one mesh share.

    Attributes:
        document: The asset.
        rig: Of the node.
        surface: The mesh, welded.
        rest: Its rest pose.
        clips: Of the asset, whichever are baked.
        neighbours: The meshes of the asset.
    """

    document: Document
    rig: Rig
    surface: Surface
    rest: Rest
    clips: tuple[Clip, ...]
    neighbours: Neighbours

    @cached_property
    def contacts(self) -> Bools:
        """(vertices,) those that must stay where they are, as `contacts_of` marks them."""
        return contacts_of(self.neighbours, self.rig, self.surface, self.rest.positions)

    @cached_property
    def poses(self) -> Floats:
        """(poses, joints, 4, 4) a few of every clip, as `poses_of`."""
        return poses_of(self.rig, self.clips, distinct_values(self.surface.joints))


def read_ground(
    document: Document,
    node: int,
    tools: list[WrinkleTool],
    settings: ToolsFile,
    clips: tuple[Clip, ...],
    *,
    neighbours: Neighbours | None = None,
) -> Ground:
    """Read the mesh of a node, at rest as the tools file says: `rest: bind` asks where its first tool is.

    Raises:
        WrinkleError: The mesh is at fault, or the clip that `rest` names is not there.
    """
    rig = read_rig(document, node)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, tools)
    return Ground(document, rig, surface, rest, clips, neighbours or Neighbours(document))


def plan_mesh(
    document: Document,
    node: int,
    tools: list[WrinkleTool],
    settings: ToolsFile,
    clips: tuple[Clip, ...],
    max_error: Length,
    *,
    influences: int | None = None,
    max_vertices: int = MAX_VERTICES,
    neighbours: Neighbours | None = None,
) -> MeshPlan:
    """Attach tools to the mesh of a node and refine it: what depends on mesh and tools only.

    New vertices have at most as many joints as the asset's sets of them can hold, or `influences`. There may be
    `max_vertices` of them. `neighbours` are those of the document, where several meshes are planned.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    ground = read_ground(document, node, tools, settings, clips, neighbours=neighbours)
    patches = attach_tools(tools, ground.surface, ground.rest, ground.rig, up=settings.up)
    return plan_on(ground, patches, settings, max_error, influences=influences, max_vertices=max_vertices)


def plan_on(
    ground: Ground,
    patches: Sequence[Patch],
    settings: ToolsFile,
    max_error: Length,
    *,
    influences: int | None = None,
    max_vertices: int = MAX_VERTICES,
) -> MeshPlan:
    """As `plan_mesh`, of tools that are attached already."""
    document, rig, surface, rest = ground.document, ground.rig, ground.surface, ground.rest
    contacts = ground.contacts
    tallest = max(patch.greatest_height for patch in patches)
    bound = max(max_error.resolve(tallest), _float32_error(rest))
    fine = refine(
        surface,
        rest,
        patches,
        rig,
        settings=settings.refinement,
        contacts=contacts,
        influences=min(influence_count(document, rig), influences or sys.maxsize),
        poses=ground.poses,
        tolerance=_PRUNING_SHARE * bound,
        max_vertices=max_vertices,
    )
    carried_patches, problems = [], []
    for patch in patches:
        try:
            carried_patches.append(demanding(carry(patch, fine, contacts), fine, rig))
        except BakeError as error:
            problems.append(error)
    if problems:
        raise BakeError.of_all(problems)
    scale = float(median(np.cbrt(np.abs(determinants(rest.blended[:, :, :3])))))
    folds, unhinged = _folds(ground, carried_patches, fine)
    return MeshPlan(
        rig=rig,
        rest=rest,
        fine=fine,
        carried_patches=tuple(carried_patches),
        tallest=tallest,
        max_error=bound,
        scale=scale,
        has_normals=_has_normals(document, rig.mesh),
        folds=folds,
        unhinged=unhinged,
    )


def _folds(
    ground: Ground, carried_patches: Sequence[CarriedPatch], fine: Refinement
) -> tuple[tuple["Fold", ...], tuple[int, ...]]:
    """Where contact is resolved, and the tools that ask for it in vain.

    Raises:
        BakeError: The library that resolves it is not there, or a node whose mesh is to be ignored.
    """
    chosen = [number for number, each in enumerate(carried_patches) if each.patch.tool.contact is not None]
    if not chosen:
        return (), ()
    if find_spec("ipctk") is None:
        tool = carried_patches[chosen[0]].patch.tool
        message = "contact needs ipctk, which is not installed: pip install 'wrinklecli[contact]'"
        raise BakeError(message, where=tool.place("contact"))
    # Imported here, as other bakes need none of it.
    from wrinklecli.character.bones import read_bones
    from wrinklecli.effects.contact.fold import find_folds

    _check_ignored(ground.document, [carried_patches[number].patch.tool for number in chosen])
    parts = read_bones(ground.document).parts
    obstacles = partial(read_obstacles, ground.document, ground.rig.node)
    folds, unhinged = find_folds(carried_patches, chosen, fine, ground.rest, ground.rig, parts, obstacles)
    return tuple(folds), tuple(unhinged)


def _check_ignored(document: Document, tools: Sequence[WrinkleTool]) -> None:
    """Refuse names of nodes that are not there, but in tools files that are for other assets too."""
    known = [str(node["name"]) for node in document.items("nodes") if "mesh" in node and "name" in node]
    problems = [
        BakeError(
            f"node {name!r} is no node with a mesh{nearest(name, known)}; there are {listed(known)}",
            where=tool.place("contact"),
        )
        for tool in tools
        if tool.contact and not tool.optional
        for name in tool.contact.ignore
        if name not in known
    ]
    if problems:
        raise BakeError.of_all(problems)


def poses_of(rig: Rig, clips: Sequence[Clip], joints: Ints | None = None) -> Floats:
    """(poses, joints, 4, 4) a few poses of every clip of the asset, whichever are baked.

    Args:
        rig: Of a mesh.
        clips: Of the asset.
        joints: Those that any vertex follows; the matrices of others are left 0. All where left out.

    Raises:
        AssetError: There are too many.
    """
    count = min(_POSES, _MOST_MATRICES // max(len(clips) * len(rig.joints), 1))
    if not count:
        message = f"has {len(clips)} clips of {len(rig.joints)} joints; the product may be {_MOST_MATRICES:,}"
        raise AssetError(message, where=rig.names[rig.node])
    chosen = np.arange(len(rig.joints)) if joints is None else joints
    poses = np.zeros((1 + len(clips) * count, len(rig.joints), 4, 4))
    poses[:1, chosen] = joint_matrices(rig, None, np.zeros(1), chosen)
    for number, clip in enumerate(clips):
        first = 1 + number * count
        poses[first : first + count, chosen] = joint_matrices(
            rig, clip, np.linspace(clip.start, clip.end, count), chosen
        )
    return poses


def _float32_error(rest: Rest) -> float:
    """Of a posed position, scene units: no bound can be held below it."""
    largest = float(np.abs(rest.positions).max())
    return _FLOAT32_STEPS * float(np.spacing(np.float32(largest)))


def _has_normals(document: Document, mesh: int) -> bool:
    return any("NORMAL" in each.get("attributes", {}) for each in document.items("meshes")[mesh]["primitives"])
