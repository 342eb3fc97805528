"""A limb that folds, in every form that glTF allows, and tools for it.

`limb(path, ...)` writes a file; `limb_asset(...)` gives the same as an `Asset`, to be changed before
`asset.write(path)` or `asset.glb()`. `write_tools(path, tool(...), ...)` writes a tools file for it.
"""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, MODES, Array, Asset, Interpolation, Json, attribute

LENGTH, RADIUS = 2.0, 0.25  # of the limb, scene units: along x around 0, and around that axis
BLEND = 0.5  # scene units around each inner joint over which skin weights change over


def _smoothstep(x: Array) -> Array:
    t = np.clip(x, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def limb_weights(xs: Array, joints: int) -> Array:
    """(vertices, joints) skin weights of the limb at places along it."""
    share = [np.ones_like(xs)]
    for joint in range(1, joints):
        share.append(_smoothstep((xs - (joint / joints - 0.5) * LENGTH) / BLEND + 0.5))
    return np.stack(share, axis=1) - np.stack([*share[1:], np.zeros_like(xs)], axis=1)


def limb_morph(positions: Array, morph: int) -> Array:
    """(vertices, 3) deltas: the first target squashes the limb's middle along x, others bulge it."""
    x, y, z = positions.T
    near = np.exp(-((x / 0.6) ** 2))
    if morph == 0:
        return np.stack([-0.3 * x * near, 0 * y, 0 * z], axis=1)
    return 0.1 * morph * near[:, None] * np.stack([0 * x, y, z], axis=1)


def limb(path: Path, *, buffer: Literal["file", "data", "percent", "folder"] = "file", **options: Any) -> Path:
    """Write a limb, and give the path; options as of `limb_asset`."""
    return limb_asset(**options).write(path, buffer=buffer)


def limb_asset(
    *,
    rings: int = 24,
    sides: int = 16,
    seam: bool = True,
    normals: bool = True,
    uvs: bool = True,
    colors: bool = False,
    tangents: bool = False,
    morphs: int = 0,
    morph_normals: bool = False,
    morph_clip: Interpolation | None = None,
    weights_at: Literal["mesh", "node", "both"] | None = None,
    primitives: int = 1,
    mode: Literal["triangles", "strip", "fan"] = "triangles",
    indices: Literal["u1", "u2", "u4"] | None = "u2",
    interleave: bool = False,
    sparse: Literal["base", "zeros"] | None = None,
    skinned: bool = True,
    joints: int = 2,
    influences: Literal[4, 8] = 4,
    weight_dtype: Literal["f4", "u1", "u2"] = "f4",
    inverse_binds: bool = True,
    root: Json | None = None,
    clip: Literal["fold", "grow"] | None = "fold",
    angle: float = 100.0,
    interpolation: Interpolation = "LINEAR",
) -> Asset:
    """A tube along x from -1 to 1 of radius 0.25, folding at its inner joints towards +y.

    Node 0 is the mesh, `limb`; then the joints, `joint_0` …, a chain; then `root`, their parent or, for an
    unskinned limb, the mesh's.

    Args:
        rings: Rings of vertices along the limb.
        sides: Vertices around; the UV seam lies at +y, where the limb folds.
        seam: Split the vertices there, and give the two sides other UVs.
        normals: Write NORMAL.
        uvs: Write TEXCOORD_0.
        colors: Write COLOR_0 as normalised bytes.
        tangents: Write TANGENT.
        morphs: Number of morph targets.
        morph_normals: Let them have NORMAL deltas too.
        morph_clip: Interpolation of a weights channel; none where left out.
        weights_at: Where stored weights are; of both, the node's count.
        primitives: Bands along the limb, each with vertices of its own.
        mode: A strip for each band of two rings; a fan of 8 for each second vertex of each second ring.
        indices: Their type; none for vertices that follow one another.
        interleave: One strided view for positions, normals and UVs.
        sparse: Store positions as sparse accessors, over wrong values or over zeros.
        skinned: With a skin; else the node carries the mesh as it is.
        joints: Of the chain, spaced evenly.
        influences: Per vertex; of 8 the further four are 0.
        weight_dtype: Of WEIGHTS_n; integers are normalised.
        inverse_binds: Write them; where not, all joints rest at the origin.
        root: Transform of the root: translation, rotation, scale or matrix.
        clip: What the animation does: folds by `angle`, or scales the root from 1 to 2.
        angle: Degrees, all inner joints together, after one second, and back after two.
        interpolation: Of the fold.
    """
    asset = Asset()
    cuts = np.linspace(0, rings - 1, primitives + 1).round().astype(int)
    stored: list[Json] = []
    for first, last in pairwise(cuts):
        corners = _band(int(first), int(last), sides, seam)
        for faces in _faces(int(last - first) + 1, sides, seam, mode):
            # Corners that follow one another need no indices; they repeat vertices instead.
            used = corners if indices else corners[faces]
            if stored and stored[-1]["_band"] == (first, last) and indices:
                attributes, targets = stored[-1]["attributes"], stored[-1].get("targets")
            else:
                attributes, targets = _attributes(
                    asset,
                    used,
                    rings,
                    sides,
                    normals=normals,
                    uvs=uvs,
                    colors=colors,
                    tangents=tangents,
                    morphs=morphs,
                    morph_normals=morph_normals,
                    interleave=interleave,
                    sparse=sparse,
                    joints=joints if skinned else 0,
                    influences=influences,
                    weight_dtype=weight_dtype,
                )
            primitive: Json = {"attributes": attributes, "mode": MODES[mode], "_band": (first, last)}
            if indices:
                primitive["indices"] = asset.accessor(faces, indices, target=ELEMENT_ARRAY_BUFFER)
            if targets:
                primitive["targets"] = targets
            stored.append(primitive)
    for primitive in stored:
        del primitive["_band"]
    mesh: Json = {"primitives": stored}
    carrier: Json = {"name": "limb", "mesh": 0}
    if morphs:
        mesh["extras"] = {"targetNames": [f"morph_{k}" for k in range(morphs)]}
        if weights_at in ("mesh", "both"):
            mesh["weights"] = [0.25] * morphs
        if weights_at in ("node", "both"):
            carrier["weights"] = [0.5] * morphs
    asset.append("meshes", mesh)
    asset.append("nodes", carrier)
    top = 0
    if skinned:
        carrier["skin"] = 0
        top = _add_skeleton(asset, joints, inverse_binds)
    if root is not None:
        top = asset.append("nodes", {"name": "root", "children": [top], **root})
    asset.append("scenes", {"nodes": [0] if top == 0 else [0, top] if skinned else [top]})
    asset.gltf["scene"] = 0
    animation: Json = {"name": clip or "morph"}
    if clip == "fold" and skinned:
        half = np.radians(angle / max(joints - 1, 1)) / 2.0 * np.array([0.0, 1.0, 0.0])
        turns: Array = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
        if interpolation == "CUBICSPLINE":
            turns = np.stack([0 * turns, turns, 0 * turns], axis=1)
        for joint in range(1, joints):
            asset.channel(animation, 1 + joint, "rotation", [0.0, 1.0, 2.0], turns, interpolation)
    if clip == "grow":
        asset.channel(animation, top, "scale", [0.0, 1.0], [[1.0] * 3, [2.0] * 3])
    if morphs and morph_clip:
        keys: Array = np.outer([0.0, 1.0, 0.25, 0.0], np.linspace(1.0, 0.5, morphs))
        if morph_clip == "CUBICSPLINE":
            keys = np.stack([0 * keys + 0.5, keys, 0 * keys - 1.0], axis=1)
        asset.channel(animation, 0, "weights", [0.0, 0.3, 0.7, 1.5], keys, morph_clip)
    if "channels" in animation:
        asset.append("animations", animation)
    return asset


def blendshape_limb(count: int = 67, *, normals: bool = True) -> Asset:
    """A limb with as many blendshapes as a face has for speech: each moves a spot, stored dense as exporters do.

    Args:
        count: Of the blendshapes.
        normals: Let them have NORMAL too; that of every fifth is 0 throughout.
    """
    rings, sides = 24, 16
    asset = limb_asset(rings=rings, sides=sides)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    positions, _ = limb_positions(*_band(0, rings - 1, sides, True).T, rings, sides)
    primitive["targets"] = []
    for spot in positions[np.linspace(0, len(positions) - 1, count).round().astype(int)]:
        near = np.maximum(0.0, 1.0 - np.linalg.norm(positions - spot, axis=1) / 0.2)
        delta = 0.02 * near[:, None] * [0.0, 1.0, 1.0]
        target = {"POSITION": asset.accessor(delta, bounds=True, target=ARRAY_BUFFER)}
        if normals:
            moved = 0.0 if len(primitive["targets"]) % 5 == 0 else 1.0
            target["NORMAL"] = asset.accessor(moved * delta, target=ARRAY_BUFFER)
        primitive["targets"].append(target)
    asset.gltf["meshes"][0]["extras"] = {"targetNames": [f"shape_{k}" for k in range(count)]}
    return asset


def sleeved_limb(*, gap: float = 0.04, every: int = 1, **options: Any) -> Asset:
    """A limb within a wider tube, node `sleeve`, that the same joints move, with every so many of the rings."""
    asset = limb_asset(**options)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    if every > 1:
        rings, sides = options["rings"], options["sides"]
        ring, side = np.divmod(_faces((rings - 1) // every + 1, sides, True, "triangles")[0], sides + 1)
        faces = asset.accessor(every * ring * (sides + 1) + side, "u2", target=ELEMENT_ARRAY_BUFFER)
        primitive = {**primitive, "indices": faces}
    positions = attribute(asset, 0, "POSITION").astype(np.float64) * [1.0, 1.0 + gap / RADIUS, 1.0 + gap / RADIUS]
    worn = {**primitive["attributes"], "POSITION": asset.accessor(positions, bounds=True, target=ARRAY_BUFFER)}
    asset.append("meshes", {"primitives": [{**primitive, "attributes": worn}]})
    node = asset.append("nodes", {"name": "sleeve", "mesh": 1, "skin": 0})
    asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


def _band(first: int, last: int, sides: int, seam: bool) -> Array:
    """(vertices, 2) ring and side of the vertices of a band; with a seam one side more than there are."""
    ring, side = np.meshgrid(np.arange(first, last + 1), np.arange(sides + seam), indexing="ij")
    return np.stack([ring.ravel(), side.ravel()], axis=1)


def _faces(rings: int, sides: int, seam: bool, mode: str) -> list[Array]:
    """Indices into a band for each primitive that its triangles take."""
    columns = sides + seam

    def vertex(ring: Any, side: Any) -> Any:
        return ring * columns + (side if seam else side % sides)

    if mode == "strip":
        side = np.arange(sides + 1)
        return [np.stack([vertex(r, side), vertex(r + 1, side)], axis=1)[:, ::-1].ravel() for r in range(rings - 1)]
    if mode == "fan":
        assert rings % 2 == 1, "fans need an odd number of rings"
        assert sides % 2 == 0, "fans need an even number of sides"
        around = [(-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)]
        return [
            np.array([vertex(r, s), *(vertex(r + i, s + j) for i, j in around)])
            for r in range(1, rings, 2)
            for s in range(1, sides, 2)
        ]
    ring, side = (each.ravel() for each in np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij"))
    a, b = vertex(ring, side), vertex(ring, side + 1)
    c, d = vertex(ring + 1, side), vertex(ring + 1, side + 1)
    return [np.stack([a, b, c, b, d, c], axis=1).ravel()]


def limb_positions(ring: Array, side: Array, rings: int, sides: int) -> tuple[Array, Array]:
    """(vertices, 3) float32 positions and normals; sides 0 and `sides` are equal to the bit."""
    angle = 2.0 * np.pi * (side % sides) / sides
    normal = np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    position = RADIUS * normal
    position[:, 0] = LENGTH * (ring / (rings - 1) - 0.5)
    return position.astype(np.float32), normal.astype(np.float32)


def _attributes(
    asset: Asset,
    corners: Array,
    rings: int,
    sides: int,
    *,
    normals: bool,
    uvs: bool,
    colors: bool,
    tangents: bool,
    morphs: int,
    morph_normals: bool,
    interleave: bool,
    sparse: str | None,
    joints: int,
    influences: int,
    weight_dtype: str,
) -> tuple[Json, list[Json]]:
    ring, side = corners.T
    position, normal = limb_positions(ring, side, rings, sides)
    uv = np.stack([side / sides, ring / (rings - 1)], axis=1)
    columns = {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv}
    wanted = [name for name, keep in zip(columns, (True, normals, uvs), strict=True) if keep]
    attributes: Json = {}
    if interleave:
        numbers = asset.interleaved(*((columns[name], "f4", False) for name in wanted))
        attributes |= dict(zip(wanted, numbers, strict=True))
    else:
        for name in wanted:
            attributes[name] = asset.accessor(columns[name], bounds=name == "POSITION", target=ARRAY_BUFFER)
    if sparse:
        attributes["POSITION"] = asset.sparse(position, base=sparse == "base")
    if tangents:
        tangent = np.tile([1.0, 0.0, 0.0, -1.0], (len(corners), 1))
        attributes["TANGENT"] = asset.accessor(tangent, target=ARRAY_BUFFER)
    if colors:
        shade = np.stack([ring * 255 // (rings - 1), 0 * ring, side % 2 * 255], axis=1)
        attributes["COLOR_0"] = asset.accessor(shade, "u1", normalized=True, target=ARRAY_BUFFER)
    if joints:
        weights = limb_weights(position[:, 0].astype(np.float64), joints)
        order = np.argsort(-weights, axis=1, kind="stable")[:, :4]
        chosen = np.take_along_axis(weights, order, 1)
        numbers_ = np.pad(np.where(chosen > 0, order, 0), ((0, 0), (0, influences - order.shape[1])))
        shares = np.pad(chosen, ((0, 0), (0, influences - order.shape[1])))
        if weight_dtype != "f4":
            limit = np.iinfo(weight_dtype).max
            shares = np.round(shares * limit)
            shares[:, 0] += limit - shares.sum(axis=1)
        for k in range(influences // 4):
            part = slice(4 * k, 4 * k + 4)
            attributes[f"JOINTS_{k}"] = asset.accessor(numbers_[:, part], "u1", target=ARRAY_BUFFER)
            attributes[f"WEIGHTS_{k}"] = asset.accessor(
                shares[:, part], weight_dtype, normalized=weight_dtype != "f4", target=ARRAY_BUFFER
            )
    targets = []
    for morph in range(morphs):
        delta = limb_morph(position.astype(np.float64), morph)
        target = {"POSITION": asset.accessor(delta, bounds=True, target=ARRAY_BUFFER)}
        if morph_normals:
            target["NORMAL"] = asset.accessor(0.0 * delta + [0.1, 0.0, 0.0], target=ARRAY_BUFFER)
        targets.append(target)
    return attributes, targets


def _add_skeleton(asset: Asset, joints: int, inverse_binds: bool) -> int:
    """Append the chain of joints and the skin; the first joint's node."""
    first = len(asset.gltf["nodes"])
    matrices = np.tile(np.eye(4), (joints, 1, 1))
    for joint in range(joints):
        start = -LENGTH / 2 if joint == 0 else LENGTH / joints
        node: Json = {"name": f"joint_{joint}", "translation": [start if inverse_binds else 0.0, 0.0, 0.0]}
        if joint + 1 < joints:
            node["children"] = [first + joint + 1]
        asset.append("nodes", node)
        matrices[joint, 0, 3] = -(joint / joints - 0.5) * LENGTH
    skin: Json = {"joints": list(range(first, first + joints)), "skeleton": first}
    if inverse_binds:
        skin["inverseBindMatrices"] = asset.accessor(matrices.transpose(0, 2, 1).reshape(-1, 16))
    asset.append("skins", skin)
    return first


def tool(**keys: Any) -> Json:
    """A tool of a tools file, on the limb's inner side of the fold where nothing else is said."""
    return {"name": "crease", "origin": [-0.4, RADIUS, 0.0], "target": [0.4, RADIUS, 0.0], "width": 0.3, **keys}


def write_tools(path: Path, *tools: Json, **header: Any) -> Path:
    """Write a tools file (YAML that is JSON too) with other top-level keys; the limb's tool where none is given.

    Unless they say otherwise, an edge is halved once at most: few tests ask what hangs on it, and it takes less time.
    """
    header = {"version": 1, "refinement": {"max_levels": 1}, **header}
    path.write_text(json.dumps({**header, "tools": list(tools) or [tool()]}))
    return path


PNG = b"\x89PNG skin"
"""An image that is copied, and never read."""


def write_parts(folder: Path, *names: str, image: str) -> Path:
    """Write limbs into a/, each in two files, the first with an image beside it, and a tools file, for a batch."""
    for name in names:
        asset = limb_asset(rings=7, sides=6)
        if name == names[0]:
            asset.gltf["images"] = [{"uri": image.replace(" ", "%20")}]
            (folder / "a" / image).parent.mkdir(parents=True)
            (folder / "a" / image).write_bytes(PNG)
        asset.write(folder / "a" / f"{name}.gltf")
    write_tools(folder / "t.yaml", tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    return folder


def flat_limb(**options: Any) -> Asset:
    """A knobbly limb of flat faces, as low-poly artists make them: each has corners of its own, with its normal."""
    asset = limb_asset(indices=None, **options)
    positions = attribute(asset, 0, "POSITION")
    positions[:, 1:] *= 1.0 + 0.15 * np.cos(6.0 * positions[:, :1])
    corners = attribute(asset, 0, "POSITION").reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    attribute(asset, 0, "NORMAL")[:] = np.repeat(normals, 3, axis=0)
    return asset


def cuffed_limb(**options: Any) -> Asset:
    """A limb with one hard edge around it, halfway: to one side of it all normals lean towards the other by 17°."""
    asset = limb_asset(primitives=2, **options)
    normals = attribute(asset, 0, "NORMAL")
    normals[:, 0] += 0.3
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return asset


def waving_limb(clips: int, *, aside: float = 10.0, **options: Any) -> Asset:
    """A limb whose joint folds it to other angles in each clip, about an axis that leans by up to `aside`°."""
    asset = limb_asset(clip=None, **options)
    numbers = np.random.default_rng(17)
    for clip in range(clips):
        lean, way = np.radians(aside) * np.sqrt(numbers.uniform()), numbers.uniform(0.0, 2.0 * np.pi)
        axis = np.array([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)])
        halves = np.radians([0.0, *numbers.uniform(40.0, 85.0, 3), 0.0]) / 2.0
        turns = np.concatenate([np.sin(halves)[:, None] * axis, np.cos(halves)[:, None]], axis=1)
        animation: Json = {"name": f"wave_{clip}"}
        asset.channel(animation, 2, "rotation", np.linspace(0.0, 2.0, len(turns)), turns)
        asset.append("animations", animation)
    return asset


def posed_limb(path: Path, *, degrees: float, time: float = 0.5) -> Path:
    """Write a limb with the clip `pose` of a single key, which folds it by some degrees."""
    asset = limb_asset(clip=None, rings=16, sides=10)
    half, animation = np.radians(degrees) / 2.0, {"name": "pose"}
    asset.channel(animation, 2, "rotation", [time], [[0.0, 0.0, np.sin(half), np.cos(half)]])
    asset.append("animations", animation)
    return asset.write(path)


def nose(*, gap: float = 0.05) -> Asset:
    """A patch of skin whose one morph target brings two places together, and a bar across, `gap` above it: glasses.

    Node 0 is the skin, in the plane z = 0; in the clip `sneer` its target `squeeze` rises to 1, and falls again. The
    skin hangs on one joint, as a nose does on a head.
    """
    asset = Asset()
    count = 17
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, count), np.linspace(-1, 1, count)))
    positions = np.stack([x, y, 0.0 * x], axis=1)
    near = np.exp(-4.0 * (x**2 + y**2))
    corners = np.add.outer(count * np.arange(count - 1), np.arange(count - 1))
    faces = np.add.outer(corners, [0, 1, count + 1, 0, count + 1, count]).reshape(-1)
    target = {"POSITION": asset.accessor(np.stack([-0.5 * x * near, 0 * x, 0 * x], axis=1), bounds=True)}
    asset.append("meshes", {"primitives": [{**_skinned(asset, positions, faces), "targets": [target]}]})
    asset.gltf["meshes"][0]["extras"] = {"targetNames": ["squeeze"]}
    box = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (0, 1)])
    bar = np.float64(box) * [0.12, 0.9, 0.1] + [0.0, 0.0, gap]
    sides = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    asset.append("meshes", {"primitives": [_skinned(asset, bar, sides[:, [0, 1, 2, 0, 2, 3]].reshape(-1))]})
    asset.append("nodes", {"name": "skin", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "glasses", "mesh": 1, "skin": 0})
    joint = asset.append("nodes", {"name": "head"})
    asset.append("skins", {"joints": [joint]})
    asset.append("scenes", {"nodes": [0, 1, 2]})
    asset.gltf["scene"] = 0
    animation: Json = {"name": "sneer"}
    asset.channel(animation, 0, "weights", [0.0, 1.0, 2.0], np.array([[0.0], [1.0], [0.0]]))
    asset.append("animations", animation)
    return asset


def _skinned(asset: Asset, positions: Array, faces: Array) -> Json:
    """A primitive whose vertices all hang on joint 0."""
    first = np.tile([1, 0, 0, 0], (len(positions), 1))
    return {
        "attributes": {
            "POSITION": asset.accessor(positions, bounds=True, target=ARRAY_BUFFER),
            "JOINTS_0": asset.accessor(0 * first, "u1", target=ARRAY_BUFFER),
            "WEIGHTS_0": asset.accessor(np.float64(first), target=ARRAY_BUFFER),
        },
        "indices": asset.accessor(faces, "u2", target=ELEMENT_ARRAY_BUFFER),
    }
