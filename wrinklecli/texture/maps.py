"""Makes wrinkle maps: lay the tools on the mesh, evaluate them at texels, pack shapes that do not meet, write."""

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, get_args

import numpy as np

from wrinklecli.baking.extras import METHOD, player_names
from wrinklecli.baking.job import BakeOptions, Job, ToolsPaths, read_job, tools_paths, wrinkles_alone
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.baking.refined_mesh import RefinedPrimitive, old_values, primitives_of
from wrinklecli.character.contacts import Neighbours
from wrinklecli.choices import MapKind
from wrinklecli.effects.effect import MeshPlan, SamplingOptions
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.effects.wrinkle.effect import WrinkleEffect
from wrinklecli.errors import AssetError, BakeError, counted, listed
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import png_of
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, flags_of, unit
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.texture.map_files import MAPS_JSON, claim_folder, image_name
from wrinklecli.texture.occlusion import REACH, occlusion
from wrinklecli.texture.relief import Relief, Textured, plan_finely
from wrinklecli.texture.tangents import mikk_tangents
from wrinklecli.texture.texels import charted, covered, gutter, texture_steps

VERSION = 1
"""The version of maps.json; a change that a reader would misunderstand raises it."""

# Texels by which charts are widened: bilinear filters and the first mip levels read beyond borders.
_GUTTER = 8
# Share of a shape's greatest height below which it does not count as being at a texel: where bumps meet, both are 0.
_PRESENT = 0.02
# Texels on which another shape may be without the two being kept apart: a line between two bumps.
_TOUCHING = 0.02
# Texels of two places that nobody sees, over those under wrinkles: charts that touch share some on their borders.
_FEW = 1e-4
# Part of the size of the mesh by which places on one texel may differ, such as on both sides of a seam.
_SAME_PLACE = 1e-4
# Bytes that a texel takes at most while the maps of a material are made, as measured at 1024 to 4096 texels a side.
_TEXEL_BYTES = 145
# Texels that a bump must be wide: with fewer, the linear filter turns normals of a bump of 45° by more than 2° between
# texels, by 45° · (2π / texels)² / 8.
_LEAST_TEXELS = 10
# The values of 16 bits that stand for no height, and for white.
_ZERO, _WHITE = 32768, 65535


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
    """

    size: int = 2048
    kinds: Sequence[MapKind] = get_args(MapKind)
    supersample: int = 2
    separate: bool = False
    only: Sequence[str] = ()
    anims: Sequence[str | os.PathLike[str]] = ()
    allow_external: bool = False
    max_memory: int = MAX_MEMORY


@dataclass(frozen=True, slots=True)
class Maps:
    """The maps that were written.

    Attributes:
        data: What maps.json says.
        paths: The files, maps.json first.
        inputs: All files that were read.
        notes: A line for each effect that maps leave out.
        warnings: A line for each fault of the texture's layout, and for each tool that has too few texels.
    """

    data: Json
    paths: tuple[str, ...]
    inputs: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

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
    progress: Progress = no_progress,
    **named: Any,
) -> Maps:
    """Write normal, height and occlusion maps of an asset's wrinkles, with masks, and maps.json that explains them.

    The mesh stays as it is: the maps are for its own texture coordinates, and its own normals and tangents.

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
        BakeError: Asset and tools do not go together, no map can be made, or a file cannot be written.
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
            only=options.only,
            anims=options.anims,
            allow_external=options.allow_external,
            max_memory=options.max_memory,
        )
        job = read_job(asset, tools, reading)
        outputs.protect([*job.inputs, *job.beside])
        job = wrinkles_alone(job)
        pixels = f"maps of {options.size} by {options.size} texels"
        job.document.memory.check(_TEXEL_BYTES * options.size**2, pixels, where=job.document.path)
        materials: list[Json] = []
        nodes: list[Json] = []
        neighbours = Neighbours(job.document)
        warnings: list[str] = list(job.warnings)
        files: dict[str, bytes] = {}
        for plan in plan_meshes(job):
            how = SamplingOptions(job.settings.sampling.fps, "morph", job.document.memory, progress)
            effects = [each for each in sample_effects(plan, [], how)[0] if isinstance(each, WrinkleEffect)]
            nodes.append(_drives(job.document.gltf, plan, effects))
            warnings += _nameless(job.document, plan, effects)
            layouts = _layouts(job.document, plan)
            shown: dict[int | None, list[_Shown]] = {}
            # One after another, as the finely refined meshes of all tools at once would take the memory of all.
            for done, effect in enumerate(effects):
                progress("refine", done, len(effects))
                texel = _texel_size(plan, effect, layouts, options.size)
                warnings += _too_few_texels(effect, texel)
                for material, found in _shown_finely(job, plan, effect, neighbours, options, how, texel):
                    shown.setdefault(material, []).extend(found)
            for layout in layouts:
                made = _made(plan, effects, layout, shown.get(layout.material, []), options, warnings)
                taken = {each["name"] for each in materials}
                name = _file_name(layout.name, taken)
                sets = [each.encoded(name, number, options, files) for number, each in enumerate(made, start=1)]
                if sets:
                    described = {"name": name, "material": layout.material, "node": plan.rig.names[plan.rig.node]}
                    materials.append({**described, "texCoord": layout.texcoord, **layout.transform_json, "sets": sets})
        if not materials:
            raise BakeError("no map can be made: its wrinkles lie on no texture coordinates", where=job.document.path)
        data = {
            "version": VERSION,
            "method": METHOD,
            "asset": os.path.basename(job.document.path),
            "size": options.size,
            "materials": materials,
            "nodes": nodes,
        }
        for name, content in files.items():
            outputs.add_bytes(os.path.join(folder, name), content)
        text = json.dumps(data, indent=1, ensure_ascii=False) + "\n"
        outputs.add_bytes(os.path.join(folder, MAPS_JSON), text.encode(), last=True)
        paths = tuple(os.path.join(folder, name) for name in (MAPS_JSON, *files))
        return Maps(data, paths, job.inputs, job.notes, tuple(warnings))


def _drives(gltf: Json, plan: MeshPlan, effects: Sequence[WrinkleEffect]) -> Json:
    """The drives of a node's tools, as the extras of a baked node hold them."""
    rig = plan.rig
    drives = [each.drive for each in effects if each.drive is not None]
    names = player_names(gltf, rig, frozenset(node for drive in drives for node in drive.nodes))
    return {
        "node": rig.names[rig.node],
        "wrinkle": {
            "method": METHOD,
            "tools": [each.to_json(names, rig.morph_names) for each in drives],
        },
    }


def _nameless(document: Document, plan: MeshPlan, effects: Sequence[WrinkleEffect]) -> list[str]:
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


@dataclass(frozen=True, slots=True)
class _Layout:
    """The fine triangles of one material with their texture coordinates.

    Attributes:
        name: The material's, or the mesh's.
        material: Its number; None for primitives without one.
        texcoord: The number of the set of texture coordinates.
        transform: KHR_texture_transform of the texture whose coordinates are used; empty without.
        faces: (triangles,) numbers among the fine triangles.
        uvs: (triangles, 3, 2) after the transform.
        normals: (triangles, 3, 3) bind space.
        tangents: (triangles, 3, 3).
        hands: (triangles,).
    """

    name: str
    material: int | None
    texcoord: int
    transform: Json
    faces: Ints
    uvs: Floats
    normals: Floats
    tangents: Floats
    hands: Floats

    @property
    def transform_json(self) -> Json:
        """The transform for maps.json."""
        return {"KHR_texture_transform": self.transform} if self.transform else {}


@dataclass(frozen=True, slots=True)
class _Transform:
    """KHR_texture_transform: coordinates are scaled, turned and moved, in this order.

    Attributes:
        stored: The extension as the asset has it; empty without.
        turn: Radians.
    """

    stored: Json = field(default_factory=dict)
    scale: tuple[float, float] = (1.0, 1.0)
    turn: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, stored: Json) -> "_Transform":
        """Read the extension; TypeError or ValueError if it is malformed."""
        (across, down), (right, below) = stored.get("scale", (1.0, 1.0)), stored.get("offset", (0.0, 0.0))
        scale, offset = (float(across), float(down)), (float(right), float(below))
        return cls(stored, scale, float(stored.get("rotation", 0.0)), offset)

    def applied(self, uvs: Floats) -> Floats:
        """(vertices, 2) transformed coordinates."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        scaled = uvs * self.scale
        turned = np.column_stack([c * scaled[:, 0] + s * scaled[:, 1], c * scaled[:, 1] - s * scaled[:, 0]])
        return np.asarray(turned + self.offset)


def _layouts(document: Document, plan: MeshPlan) -> list[_Layout]:
    """The materials of a mesh with texture coordinates; primitives without them are left out."""
    primitives = document.items("meshes")[plan.rig.mesh]["primitives"]
    parts: dict[int | None, list[_Layout]] = {}
    for refined in primitives_of(plan.fine):
        primitive = primitives[refined.index]
        attributes = primitive.get("attributes", {})
        material = _material_of(document, primitive)
        texcoord, transform = _texture_of(document, material)
        key = f"TEXCOORD_{texcoord}"
        if key not in attributes or not len(refined.triangles):
            continue
        where = document.where("meshes", plan.rig.mesh, "primitives", refined.index)
        uvs = transform.applied(old_values(document, attributes, key, refined, size=2, where=where))
        old = np.arange(len(refined.old))
        if "NORMAL" in attributes:
            normals = unit(old_values(document, attributes, "NORMAL", refined, size=3, where=where))
        else:
            normals = plan.fine.normals_at(refined.weld[old])
        if "TANGENT" in attributes:
            tangents = old_values(document, attributes, "TANGENT", refined, size=4, where=where)
        else:
            surface = plan.fine.surface
            own = surface.corners[surface.primitives == refined.index] - refined.old[0]
            tangents = mikk_tangents(surface.positions[refined.weld[old]], normals, uvs, own)
        parts.setdefault(material, []).append(
            _Layout(
                name=_name_of(document, material, plan),
                material=material,
                texcoord=texcoord,
                transform=transform.stored,
                faces=np.flatnonzero(plan.fine.triangle_primitives == refined.index),
                uvs=_on_corners(refined, uvs),
                normals=_on_corners(refined, normals),
                tangents=_on_corners(refined, tangents[:, :3]),
                hands=np.where(_on_corners(refined, tangents[:, 3:])[..., 0].sum(axis=1) < 0, -1.0, 1.0),
            )
        )
    return [_joined(each) for each in parts.values()]


def _on_corners(refined: RefinedPrimitive, values: Floats) -> Floats:
    """(triangles, 3, …) of (old vertices, …) values of a primitive."""
    found: Floats = np.concatenate([values, refined.mix(values)])[refined.triangles]
    return found


def _joined(parts: Sequence[_Layout]) -> _Layout:
    """The primitives of one material as one."""
    return replace(
        parts[0],
        faces=np.concatenate([each.faces for each in parts]),
        uvs=np.concatenate([each.uvs for each in parts]),
        normals=np.concatenate([each.normals for each in parts]),
        tangents=np.concatenate([each.tangents for each in parts]),
        hands=np.concatenate([each.hands for each in parts]),
    )


def _material_of(document: Document, primitive: Json) -> int | None:
    """The number of a primitive's material; None without one, or if there is none of that number."""
    number = primitive.get("material")
    return number if isinstance(number, int) and 0 <= number < len(document.items("materials")) else None


def _texture_of(document: Document, material: int | None) -> tuple[int, _Transform]:
    """The set of coordinates and the transform that a map takes: the normal map's, or else the base colour's.

    Raises:
        AssetError: An entry is malformed.
    """
    if material is None:
        return 0, _Transform()
    where = document.where("materials", material)
    try:
        known = document.items("materials")[material]
        base = known.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        texture = known.get("normalTexture") or base or {}
        stored = texture.get("extensions", {}).get("KHR_texture_transform", {})
        return int(stored.get("texCoord", texture.get("texCoord", 0))), _Transform.of(stored)
    except (TypeError, ValueError, AttributeError) as error:
        raise AssetError(f"its texture is malformed: {error}", where=where) from error


def _name_of(document: Document, material: int | None, plan: MeshPlan) -> str:
    named = document.items("materials")[material].get("name") if material is not None else None
    return str(named or plan.rig.names[plan.rig.node])


def _file_name(name: str, taken: set[str]) -> str:
    """Letters, digits and `_` of a name, different from others whatever the case."""
    plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "material"
    lower, found, number = {each.lower() for each in taken}, plain, 1
    while found.lower() in lower:
        number += 1
        found = f"{plain}_{number}"
    return found


@dataclass(frozen=True, slots=True)
class _Shown:
    """One weight's shape on a texture.

    Attributes:
        target: The name of its weight.
        tool: The name of its tool.
        texels: (texels,) sorted numbers of the texels that it moves.
        heights: (texels,) scene units at weight 1.
        slopes: (texels, 2) as those of a `Relief`.
    """

    target: str
    tool: str
    texels: Ints
    heights: Floats
    slopes: Floats

    @property
    def shares(self) -> Floats:
        """(texels,) heights over the tallest."""
        sizes = np.abs(self.heights)
        found: Floats = sizes / sizes.max()
        return found

    @property
    def present(self) -> Ints:
        """The texels where it counts as being there."""
        found: Ints = self.texels[self.shares > _PRESENT]
        return found


@dataclass(frozen=True, slots=True)
class _Set:
    """Shapes that share maps, as no texel has two of them.

    Attributes:
        shown: The shapes.
        charts: (size²,) the triangle under each texel, −1 for none.
        steps: (triangles, 2, 3) steps of a texel to the right and down on the surface, scene units.
    """

    shown: list[_Shown]
    charts: Ints
    steps: Floats

    def encoded(self, owner: str, number: int, options: MapOptions, files: dict[str, bytes]) -> Json:
        """Write the images into `files`, and describe them."""
        name = partial(image_name, owner, number)
        size = options.size
        heights, slopes = np.zeros(size**2), np.zeros((size**2, 2))
        largest, holder = np.zeros(size**2), np.full(size**2, -1, np.int16)
        filled = self.charts >= 0
        for which, each in enumerate(self.shown):
            heights[each.texels] += each.heights
            slopes[each.texels] += each.slopes
            filled[each.texels] = True
            more = each.shares > largest[each.texels]
            largest[each.texels[more]], holder[each.texels[more]] = each.shares[more], which
        beside, nearest = gutter(filled.reshape(size, size), _GUTTER)

        def image(values: Floats) -> Floats:
            values[beside] = values[nearest]
            return values.reshape(size, size, *values.shape[1:])

        said: Json = {}
        if "normal" in options.kinds:
            normals = unit(np.column_stack([slopes, np.ones(size**2)]))
            files[name("normal")] = png_of(np.rint(image(127.5 + 127.5 * normals)).astype(np.uint8))
            said["normal"] = name("normal")
        if "height" in options.kinds:
            limit = float(np.abs(heights).max())
            stored = np.rint(image(_ZERO + (_WHITE - _ZERO) * heights / limit)).astype(np.uint16)
            files[name("height")] = png_of(stored)
            scale = limit * _WHITE / (_WHITE - _ZERO)
            said["height"] = {"file": name("height"), "zero": _ZERO / _WHITE, "scale": scale}
        if "ao" in options.kinds:
            files[name("ao")] = png_of(np.rint(255.0 * image(self._seen(heights, size))).astype(np.uint8))
            said["ao"] = name("ao")
        said["weights"] = []
        for start in range(0, len(self.shown), 4):
            part = self.shown[start : start + 4]
            mask = name(f"mask_{1 + start // 4}")
            if len(self.shown) > 1:
                # A channel of transparency only where there are four: viewers show such images as nearly nothing.
                channels = range(start, start + max(len(part), 3))
                owned = np.column_stack([holder == channel for channel in channels])
                files[mask] = png_of(image(np.where(owned, 255.0, 0.0)).astype(np.uint8))
            for channel, each in zip("rgba", part, strict=False):
                masked = {"mask": mask, "channel": channel} if len(self.shown) > 1 else {}
                said["weights"].append({"target": each.target, "tool": each.tool, **masked})
        return said

    def _seen(self, heights: Floats, size: int) -> Floats:
        """(size²,) the occlusion of (size²,) heights."""
        seen = np.ones((size, size))
        rows, columns = np.divmod(np.flatnonzero(heights), size)
        # Beyond the reach of the wrinkles all is seen.
        window = tuple(slice(max(int(each.min()) - REACH, 0), int(each.max()) + REACH + 1) for each in (rows, columns))
        charts = self.charts.reshape(size, size)[window]
        raised = heights.reshape(size, size)[window]
        seen[window] = occlusion(raised, self.steps[charts], charts >= 0)
        return seen.reshape(-1)


def _texel_size(plan: MeshPlan, effect: WrinkleEffect, layouts: Sequence[_Layout], size: int) -> float:
    """The side of a texel on the surface at rest, scene units: the median under a tool; 0 if it has no texel."""
    moved = flags_of(effect.carried.vertices, len(plan.fine.positions))
    sides = [np.zeros(0)]
    for layout in layouts:
        textured = _textured(plan, layout, size)
        under = np.flatnonzero(any_of(moved, textured.triangles))
        corners = plan.fine.rest_positions[textured.triangles[under]]
        right, down = np.einsum("fdk,fkx->dfx", textured.steps[under], corners)
        sides.append(np.sqrt(np.linalg.norm(np.cross(right, down), axis=1)))
    every = np.concatenate(sides)
    return float(np.median(every[every > 0.0])) if every.any() else 0.0


def _too_few_texels(effect: WrinkleEffect, texel: float) -> list[str]:
    """A warning if a tool's bumps have too few texels for their normals."""
    patch = effect.carried.patch
    width = 2.0 * patch.span / patch.curve.interval_count
    if not texel or width >= _LEAST_TEXELS * texel:
        return []
    return [
        f"{effect.name}: a bump is {width / texel:.2g} texels wide, and normals between fewer than {_LEAST_TEXELS} are"
        " off by more than 2°: raise --size, or give the place more of the texture"
    ]


def _shown_finely(
    job: Job,
    plan: MeshPlan,
    effect: WrinkleEffect,
    neighbours: Neighbours,
    options: MapOptions,
    how: SamplingOptions,
    texel: float,
) -> Iterator[tuple[int | None, list[_Shown]]]:
    """The shapes of a tool, with the number of each material that shows them."""
    if not texel:
        return
    patch, side = effect.carried.patch, options.size * options.supersample
    samples = patch.span / patch.intervals / texel * options.supersample
    fine, own = plan_finely(job, plan.rig.node, patch.tool, neighbours, how, most_edges=samples)
    relief = Relief.of(own, fine.fine)
    for layout in _layouts(job.document, fine):
        textured = _textured(fine, layout, side)
        faces = np.flatnonzero(relief.covers(textured.triangles))
        yield layout.material, _shown(effect, relief, textured, layout.uvs, faces, options)


def _made(
    plan: MeshPlan,
    effects: Sequence[WrinkleEffect],
    layout: _Layout,
    shown: Sequence[_Shown],
    options: MapOptions,
    warnings: list[str],
) -> list[_Set]:
    """The sets of one material; a warning for wrinkles on texels that several places share."""
    if not shown:
        return []
    textured = _textured(plan, layout, options.size)
    moved = np.concatenate([each.carried.vertices for each in effects])
    wrinkled = any_of(flags_of(moved, len(plan.fine.positions)), textured.triangles)
    charts, pairs = charted(layout.uvs, options.size)
    warnings += _overlaps(plan, layout, pairs, wrinkled, int(wrinkled[charts[charts >= 0]].sum()))
    corners = plan.fine.rest_positions[textured.triangles]
    steps = np.einsum("fdk,fkx->fdx", textured.steps, corners)
    groups = [[each] for each in shown] if options.separate else _packed(shown, options.size)
    return [_Set(each, charts, steps) for each in groups]


def _shown(
    effect: WrinkleEffect,
    relief: Relief,
    textured: Textured,
    uvs: Floats,
    faces: Ints,
    options: MapOptions,
) -> list[_Shown]:
    """The shapes of a tool's targets on the triangles that it moves, each texel the mean of its samples.

    The relief has a shape for each target, whether the bake's own mesh shows it or not.
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
    means, count = sums[:, 1:] / sums[:, :1], len(effect.targets)
    made = []
    for number, target in enumerate(effect.targets):
        heights, slopes = means[:, number], means[:, count + 2 * number : count + 2 * number + 2]
        moved = np.flatnonzero(heights)
        if target is not None and len(moved):
            made.append(_Shown(target.name, effect.name, texels[moved], heights[moved], slopes[moved]))
    return made


def _summed(texels: Ints, values: Floats) -> tuple[Ints, Floats]:
    """The distinct ones of (samples,) texels, sorted, and the sums of the (samples, columns) values of each."""
    order = np.argsort(texels, kind="stable")
    found, starts = np.unique(texels[order], return_index=True)
    return found, np.add.reduceat(values[order], starts, axis=0) if len(found) else values


def _textured(plan: MeshPlan, layout: _Layout, side: int) -> Textured:
    """The corners of a material's triangles, for a texture with so many samples of a side."""
    triangles, steps = plan.fine.triangles[layout.faces], texture_steps(layout.uvs, side)
    return Textured(triangles, layout.normals, layout.tangents, layout.hands, steps)


def _packed(shown: Sequence[_Shown], size: int) -> list[list[_Shown]]:
    """Put shapes into as few groups as first fit finds, so that those of a group meet on lines at most."""
    groups: list[tuple[list[_Shown], Bools]] = []
    for each in shown:
        present = each.present
        for group, taken in groups:
            if taken[present].sum() <= _TOUCHING * len(present):
                group.append(each)
                taken[present] = True
                break
        else:
            taken = np.zeros(size**2, np.bool_)
            taken[present] = True
            groups.append(([each], taken))
    return [group for group, _ in groups]


def _overlaps(plan: MeshPlan, layout: _Layout, pairs: Ints, wrinkled: Bools, count: int) -> list[str]:
    """A warning if other places of the mesh have some of the `count` texels of wrinkles."""
    texels, first, second = pairs[wrinkled[pairs[:, 1]] | wrinkled[pairs[:, 2]]].T
    middles = plan.fine.rest_positions[plan.fine.triangles[layout.faces]].mean(axis=1)
    apart = np.linalg.norm(middles[first] - middles[second], axis=1) > _SAME_PLACE * plan.fine.rest_size
    shared = len(np.unique(texels[apart]))
    if shared <= _FEW * count:
        return []
    e1, e2 = layout.uvs[:, 1] - layout.uvs[:, 0], layout.uvs[:, 2] - layout.uvs[:, 0]
    turned = np.sign(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])
    mirrored = (turned[first] != turned[second])[apart].mean() > 0.5
    how = "mirrored on each other" if mirrored else "on each other"
    return [
        f"{layout.name}: {100.0 * shared / max(count, shared):.3g} % of the texels under wrinkles belong to two places,"
        f" laid {how}: both show the same wrinkles; unwrap them apart, or into a second set of texture coordinates for"
        " the normal map"
    ]
