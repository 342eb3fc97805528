"""Makes wrinkle maps: lay the tools on the mesh, evaluate them at texels, pack shapes that do not meet, write."""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, count
from typing import Any, get_args

import numpy as np

from wrinklecli.baking.extras import METHOD, drives_json
from wrinklecli.baking.job import BakeOptions, Job, ToolsPaths, read_job, tools_paths
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.contacts import Neighbours
from wrinklecli.choices import MOST_TEXELS, MapKind
from wrinklecli.effects.effect import Effect, MeshPlan, Part, SamplingOptions
from wrinklecli.effects.plan import skin_parts
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.errors import BakeError, counted, listed, log_findings
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import png_of
from wrinklecli.gltf.shape import Json, json_bytes
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.arrays import Floats, Ints, any_of, flags_of
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.texture.layout import Layout, TexCoords, layouts_of, signed_areas
from wrinklecli.texture.map_files import MAPS_JSON, claim_folder
from wrinklecli.texture.map_set import MapSet, Shown, packed
from wrinklecli.texture.relief import Relief, Textured, plan_finely
from wrinklecli.texture.texels import charted, covered
from wrinklecli.texture.unwrap import require_xatlas, unwrapped

VERSION = 1
"""The version of maps.json; a change that a reader would misunderstand raises it."""

# Texels of two places that nobody sees, over those under wrinkles: charts that touch share some on their borders.
_FEW = 1e-4
# Part of the size of the mesh by which places on one texel may differ, such as on both sides of a seam.
_SAME_PLACE = 1e-4
# Bytes that a texel takes at most while the maps of a material are made, as measured at 1024 to 4096 texels a side.
_TEXEL_BYTES = 145
# Texels across a bump from which on the linear filter turns normals of a bump of 45° by 2° at most between texels, by
# 45° · (2π / texels)² / 8,
_GOOD_TEXELS = 10
# and below which it turns them by more than 6°, and one sees texels in place of a bump.
_LEAST_TEXELS = 6


@dataclass(frozen=True, slots=True)
class MapOptions:
    """The settings of `maps`.

    Attributes:
        size: Texels of a side.
        kinds: The maps to write.
        supersample: Samples of a texel along either side.
        separate: Write maps for each weight, in place of maps that several weights share by masks.
        only: Names of the tools to use; all of them if empty.
        anims: Files with clips that tools may name.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Most bytes that reading the asset may take.
        unwrap: The .glb or .gltf to write, the asset with a further set of texture coordinates, which the maps take.
    """

    size: int = 2048
    kinds: Sequence[MapKind] = get_args(MapKind)
    supersample: int = 2
    separate: bool = False
    only: Sequence[str] = ()
    anims: Sequence[str | os.PathLike[str]] = ()
    allow_external: bool = False
    max_memory: int = MAX_MEMORY
    unwrap: str | os.PathLike[str] | None = None


@dataclass(frozen=True, slots=True)
class Maps:
    """The maps that were written.

    Attributes:
        data: What maps.json says.
        paths: The files, maps.json first.
        notes: A line for each effect that maps leave out.
        warnings: A line for each fault of the texture's layout, and for each tool that has too few texels.
    """

    data: Json
    paths: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def record(self) -> Json:
        """The record of what was written, for `--json`: JSON values only."""
        return {
            "size": self.data["size"],
            "files": list(self.paths),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
        }

    @property
    def summary(self) -> str:
        """Say what was written, in a line."""
        materials = self.data["materials"]
        sets = [part for each in materials for part in each["sets"]]
        weights = counted(sum(len(part["weights"]) for part in sets), "weight")
        images = counted(len(self.paths) - 1, "image")
        return f"{images} of {counted(len(materials), 'material')}, {weights} in {counted(len(sets), 'set')}"


def maps(
    asset: str | os.PathLike[str],
    tools: ToolsPaths,
    folder: str | os.PathLike[str],
    options: MapOptions | None = None,
    *,
    outputs: Outputs | None = None,
    progress: Progress = log_progress,
    **named: Any,
) -> Maps:
    """Write normal, height and occlusion maps of an asset's wrinkles, with masks, and maps.json that explains them.

    The mesh stays as it is, and the maps fit its own texture coordinates, normals and tangents. With `unwrap`, a copy
    of the asset has coordinates for them.

    Args:
        asset: The .gltf or .glb to read.
        tools: The YAML file of tools, or several that are merged.
        folder: The folder to write into.
        options: The defaults of `MapOptions` if None.
        outputs: The files are added to these. If None, they are committed before returning.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `MapOptions`, in place of those in `options`.

    Raises:
        ConfigError: The tools file is at fault.
        AssetError: The asset is at fault.
        BakeError: Asset and tools do not go together, a bump has too few texels, or a file cannot be written.
        TypeError: `MapOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import maps
        >>> made = maps("samples/head.glb", "configs/head.yaml", "maps", size=256, kinds=["normal"])
        >>> made.data["materials"][0]["sets"][0]["normal"]
        'skin_1_normal.png'
    """
    options = replace(options or MapOptions(), **named)
    path = os.fspath(folder)
    with part_of(outputs) as written:
        claim_maps(path, written)
        if options.unwrap is not None:
            require_xatlas()
            written.claim(options.unwrap)
        return make_maps(asset, tools, path, options, written, progress)


def claim_maps(folder: str, outputs: Outputs) -> None:
    """Announce the maps of a folder before the work is done.

    Raises:
        BakeError: Pillow, which writes the images, is not installed, or the folder's files cannot be written.
    """
    try:
        png_of(np.zeros((1, 1), np.uint8))
    except ImportError as error:
        raise BakeError(f"maps need Pillow ({error}): pip install 'wrinklecli[maps]'") from error
    claim_folder(folder, outputs)


def make_maps(
    asset: str | os.PathLike[str],
    tools: ToolsPaths,
    folder: str,
    options: MapOptions,
    outputs: Outputs,
    progress: Progress,
) -> Maps:
    """Make maps as `maps` does, in a folder that `claim_maps` has announced."""
    with guarded(os.fspath(asset)):
        outputs.protect([asset, *tools_paths(tools), *options.anims])
        reading = BakeOptions(
            mode="weights",
            only=options.only,
            anims=options.anims,
            allow_external=options.allow_external,
            max_memory=options.max_memory,
        )
        job = read_job(asset, tools, reading)
        outputs.protect([*job.inputs, *job.beside])
        pixels = f"maps of {options.size} by {options.size} texels"
        job.document.memory.check(_TEXEL_BYTES * options.size**2, pixels, where=job.document.path)
        plans = plan_meshes(job)
        texcoords: TexCoords = {}
        if options.unwrap is not None:
            edited, texcoords = unwrapped(job, plans, options.size, progress)
            write(edited, options.unwrap, outputs=outputs)
            job = read_job(edited.document(), tools, reading)
            plans = plan_meshes(job)
        materials: list[Json] = []
        nodes: list[Json] = []
        neighbours = Neighbours(job.document)
        layouts_of_plans = [layouts_of(job.document, plan, texcoords) for plan in plans]
        texels = [
            [_texel_size(plan, part, layouts, options.size) for part in skin_parts(plan)]
            for plan, layouts in zip(plans, layouts_of_plans, strict=True)
        ]
        warnings: list[str] = [*job.warnings, *_too_few_texels(job, plans, texels, options)]
        files: dict[str, bytes] = {}
        for plan, layouts, sides in zip(plans, layouts_of_plans, texels, strict=True):
            how = SamplingOptions(job.settings.sampling.fps, "morph", job.document.memory, progress)
            effects, _ = sample_effects(plan, [], how)
            drives = drives_json(job.document.gltf, plan, effects)
            nodes.append({"node": plan.rig.node_name, "wrinkle": drives})
            warnings += _nameless(job.document, plan, effects)
            shown: dict[int | None, list[Shown]] = {}
            # The shapes of tools by the materials that show them. Tools come one after another, as the finely refined
            # meshes of all at once would take the memory of all.
            for done, (effect, part, side) in enumerate(zip(effects, skin_parts(plan), sides, strict=True)):
                progress("refine", done, len(effects))
                region, tool = part.attached.regions[0], part.attached.tool
                samples = region.span / region.intervals / side * options.supersample
                fine, own = plan_finely(job, plan.rig.node, tool, neighbours, how, most_edges=samples)
                relief = Relief.of(own, fine.fine)
                for layout in layouts_of(job.document, fine, texcoords):
                    textured = layout.textured(fine, options.size * options.supersample)
                    faces = np.flatnonzero(relief.covers(textured.triangles))
                    found = _shown(effect, relief, textured, layout.uvs, faces, options)
                    shown.setdefault(layout.material, []).extend(found)
            for layout in layouts:
                made = _made(plan, layout, shown.get(layout.material, []), options, warnings)
                taken = {each["name"] for each in materials}
                name = _file_name(layout.name, taken)
                sets = [
                    each.encoded(name, number, options.size, options.kinds, files)
                    for number, each in enumerate(made, start=1)
                ]
                if sets:
                    described = {"name": name, "material": layout.material, "node": plan.rig.node_name}
                    transform = {"KHR_texture_transform": layout.transform} if layout.transform else {}
                    materials.append({**described, "texCoord": layout.texcoord, **transform, "sets": sets})
        if not materials:
            raise BakeError("no map can be made: no texel lies under its wrinkles", where=job.document.path)
        data = {
            "version": VERSION,
            "method": METHOD,
            "asset": os.path.basename(options.unwrap or job.document.path),
            "size": options.size,
            "materials": materials,
            "nodes": nodes,
        }
        for name, content in files.items():
            outputs.add_bytes(os.path.join(folder, name), content)
        outputs.add_bytes(os.path.join(folder, MAPS_JSON), json_bytes(data, indent=1) + b"\n", last=True)
        paths = tuple(os.path.join(folder, name) for name in (MAPS_JSON, *files))
        log_findings(warnings, job.notes, where=job.document.path)
        return Maps(data, paths, job.notes, tuple(warnings))


def _file_name(name: str, taken: set[str]) -> str:
    """Letters, digits and `_` of a name, different from others whatever the case."""
    plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "material"
    names, lower = chain([plain], (f"{plain}_{number}" for number in count(2))), {each.lower() for each in taken}
    return next(each for each in names if each.lower() not in lower)


def _nameless(document: Document, plan: MeshPlan, effects: Sequence[Effect]) -> list[str]:
    """A warning if joints of drives have no names: the asset, which stays as it is, does not get any."""
    nodes = document.items("nodes")
    joints = sorted({node for each in effects if each.drive is not None for node in each.drive.nodes})
    unnamed = [plan.rig.names[node] for node in joints if not nodes[node].get("name")]
    if not unnamed:
        return []
    return [
        f"{document.path}: {counted(len(unnamed), 'joint')} of tools have no name, and players look joints up by name;"
        f" maps.json calls them {listed(unnamed)}"
    ]


def _texel_size(plan: MeshPlan, part: Part, layouts: Sequence[Layout], size: int) -> float:
    """The side of a texel on the surface at rest, scene units: the median under a tool; 0 if it has no texel."""
    moved = flags_of(part.vertices, len(plan.fine.positions))
    sides = [np.zeros(0)]
    for layout in layouts:
        textured = layout.textured(plan, size)
        under = np.flatnonzero(any_of(moved, textured.triangles))
        corners = plan.fine.rest_positions[textured.triangles[under]]
        right, down = np.einsum("fdk,fkx->dfx", textured.steps[under], corners)
        sides.append(np.sqrt(np.linalg.norm(np.cross(right, down), axis=1)))
    every = np.concatenate(sides)
    return float(np.median(every[every > 0.0])) if every.any() else 0.0


def _too_few_texels(
    job: Job, plans: Sequence[MeshPlan], texels: Sequence[Sequence[float]], options: MapOptions
) -> list[str]:
    """A warning for each tool whose bumps have fewer texels than would be good, with the size that has enough.

    Raises:
        BakeError: Bumps have no texels, or too few to show them.
    """
    most = MOST_TEXELS // options.supersample
    other = "`wrinkle maps --unwrap FILE` gives it texels of its own"
    refused: list[BakeError] = []
    warnings: list[str] = []
    for plan, sides in zip(plans, texels, strict=True):
        for part, texel in zip(skin_parts(plan), sides, strict=True):
            name, width = part.attached.tool.name, part.attached.bump_width
            if not texel:
                message = f"{name}: its wrinkles lie on no texture coordinates: {other}"
                refused.append(BakeError(message, where=job.document.path))
                continue
            count = width / texel
            enough = 2 ** math.ceil(math.log2(options.size * _GOOD_TEXELS / count))
            ways = f"--size {enough} is enough" if enough <= most else f"no --size up to {most} is enough"
            ways += "" if options.unwrap else f", or {other}" if enough <= most else f", but {other}"
            said = f"{name}: a bump is {count:.2g} texels wide, and"
            if count < _LEAST_TEXELS:
                message = f"{said} with fewer than {_LEAST_TEXELS} one sees texels in its place: {ways}"
                refused.append(BakeError(message, where=job.document.path))
            elif count < _GOOD_TEXELS:
                warnings.append(f"{said} normals between fewer than {_GOOD_TEXELS} are off by more than 2°: {ways}")
    if refused:
        raise BakeError.of_all(refused)
    return warnings


def _made(
    plan: MeshPlan,
    layout: Layout,
    shown: Sequence[Shown],
    options: MapOptions,
    warnings: list[str],
) -> list[MapSet]:
    """The sets of one material; a warning for wrinkles on texels that several places share."""
    if not shown:
        return []
    textured = layout.textured(plan, options.size)
    moved = np.concatenate([each.vertices for each in skin_parts(plan)])
    wrinkled = any_of(flags_of(moved, len(plan.fine.positions)), textured.triangles)
    charts, pairs = charted(layout.uvs, options.size, wrinkled)
    warnings += _overlaps(plan, layout, pairs, int(wrinkled[charts[charts >= 0]].sum()))
    corners = plan.fine.rest_positions[textured.triangles]
    steps = np.einsum("fdk,fkx->fdx", textured.steps, corners)
    groups = [[each] for each in shown] if options.separate else packed(shown, options.size)
    return [MapSet(each, charts, steps) for each in groups]


def _shown(
    effect: Effect,
    relief: Relief,
    textured: Textured,
    uvs: Floats,
    faces: Ints,
    options: MapOptions,
) -> list[Shown]:
    """The shapes of a tool's targets on the triangles that it moves, each texel the mean of its samples.

    The relief may have shapes that move no vertex of the bake's own mesh, and so have no target.
    """
    size, factor = options.size, options.supersample
    side = size * factor
    seen = np.zeros(side**2, np.bool_)
    parts: list[tuple[Ints, Floats]] = []  # texels, and the sums of their samples: a count, heights, slopes
    for hits, triangles, shares in covered(uvs[faces], side):
        # Where triangles meet, or places share a texel, the first counts.
        _, first = np.unique(hits, return_index=True)
        first = first[~seen[hits[first]]]
        seen[hits[first]] = True
        if not len(first):
            continue
        found, turned = relief.at(textured, faces[triangles[first]], shares[first])
        rows, columns = np.divmod(hits[first], side)
        slopes = turned.transpose(1, 0, 2).reshape(len(first), -1)
        values = np.concatenate([np.ones((len(first), 1)), found.T, slopes], axis=1)
        parts.append(_summed((rows // factor) * size + columns // factor, values))
    if not parts:
        return []
    texels, sums = _summed(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    means, count = sums[:, 1:] / sums[:, :1], len(relief.numbers)
    rows_of = {number: row for row, number in enumerate(relief.numbers)}
    made = []
    for target in effect.targets:
        row = rows_of.get(target.number)
        if row is None:
            continue
        heights, slopes = means[:, row], means[:, count + 2 * row : count + 2 * row + 2]
        moved = np.flatnonzero(heights)
        if len(moved):
            made.append(Shown(target.name, effect.name, texels[moved], heights[moved], slopes[moved]))
    return made


def _summed(texels: Ints, values: Floats) -> tuple[Ints, Floats]:
    """The distinct ones of (samples,) texels, sorted, and the sums of the (samples, columns) values of each."""
    order = np.argsort(texels, kind="stable")
    found, starts = np.unique(texels[order], return_index=True)
    return found, np.add.reduceat(values[order], starts, axis=0) if len(found) else values


def _overlaps(plan: MeshPlan, layout: Layout, pairs: Ints, count: int) -> list[str]:
    """A warning if places share some of the `count` texels of wrinkles, of which (pairs, 3) have two triangles."""
    texels, first, second = pairs.T
    middles = plan.fine.rest_positions[plan.fine.triangles[layout.faces]].mean(axis=1)
    apart = np.linalg.norm(middles[first] - middles[second], axis=1) > _SAME_PLACE * plan.fine.rest_size
    shared = len(np.unique(texels[apart]))
    if shared <= _FEW * count:
        return []
    turned = np.sign(signed_areas(layout.uvs))
    mirrored = (turned[first] != turned[second])[apart].mean() > 0.5
    how = "mirrored on each other" if mirrored else "on each other"
    return [
        f"{layout.name}: {100.0 * shared / max(count, shared):.3g} % of the texels under wrinkles belong to two places,"
        f" laid {how}: both show the same wrinkles; unwrap them apart, or into a second set of texture coordinates for"
        " the normal map"
    ]
