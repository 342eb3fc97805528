"""glTF documents built in code for the tests: a limb that folds, and the parts to build others from.

`limb(path, ...)` writes a file; `limb_asset(...)` gives the same as an `Asset`, to be changed before
`asset.write(path)` or `asset.glb()`. `write_tools(path, tool(...), ...)` writes a tools file for it.
"""

import base64
import json
import struct
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.pose import Clip, Rig, joint_matrices, read_clips, read_rig
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.method.patch import Patch, Rest, attach_tools, rest_pose
from wrinklecli.method.refine import Refinement, refine
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import ToolsFile

Json = dict[str, Any]
Array = NDArray[Any]
Interpolation = Literal["LINEAR", "STEP", "CUBICSPLINE"]

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
MODES = {"triangles": 4, "strip": 5, "fan": 6}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

LENGTH, RADIUS = 2.0, 0.25  # of the limb, scene units: along x around 0, and around that axis
BLEND = 0.5  # scene units around each inner joint over which skin weights change over


@dataclass
class Asset:
    """A glTF document under construction: its JSON and the bytes of its one buffer."""

    gltf: Json = field(default_factory=lambda: {"asset": {"version": "2.0"}})
    data: bytearray = field(default_factory=bytearray)

    def append(self, kind: str, item: Json) -> int:
        """Append to a top-level array, and give the index."""
        items: list[Json] = self.gltf.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes, *, stride: int | None = None, target: int | None = None) -> int:
        """Append bytes at a multiple of 4, and a buffer view on them."""
        self.data += bytes(-len(self.data) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        if stride is not None:
            view["byteStride"] = stride
        if target is not None:
            view["target"] = target
        return self.append("bufferViews", view)

    def accessor(
        self,
        values: Any,
        dtype: str = "f4",
        *,
        normalized: bool = False,
        bounds: bool = False,
        target: int | None = None,
        **more: Any,
    ) -> int:
        """Append an accessor of (count,) or (count, components) values with a view of its own."""
        stored = np.asarray(values).astype(f"<{dtype}")
        rows = stored.reshape(len(stored), -1)
        stride = None
        data = rows.tobytes()
        if target == ARRAY_BUFFER and rows.itemsize * rows.shape[1] % 4:
            size = rows.itemsize * rows.shape[1]
            stride = size + -size % 4
            data = np.pad(np.frombuffer(data, np.uint8).reshape(-1, size), ((0, 0), (0, stride - size))).tobytes()
        view = self.view(data, stride=stride, target=target)
        return self._describe(rows, dtype, view, 0, normalized=normalized, bounds=bounds, **more)

    def interleaved(self, *columns: tuple[Any, str, bool]) -> list[int]:
        """Append accessors of (values, dtype, normalized) that share one strided view."""
        parts = [np.asarray(values).astype(f"<{dtype}").reshape(len(values), -1) for values, dtype, _ in columns]
        bytes_ = [np.frombuffer(part.tobytes(), np.uint8).reshape(len(part), -1) for part in parts]
        padded = [np.pad(each, ((0, 0), (0, -each.shape[1] % 4))) for each in bytes_]
        offsets = np.cumsum([0] + [each.shape[1] for each in padded])
        view = self.view(np.concatenate(padded, axis=1).tobytes(), stride=int(offsets[-1]), target=ARRAY_BUFFER)
        return [
            self._describe(part, dtype, view, int(offset), normalized=normalized, bounds=dtype == "f4")
            for part, (_, dtype, normalized), offset in zip(parts, columns, offsets[:-1], strict=True)
        ]

    def sparse(self, values: Any, *, base: bool, index_dtype: str = "u2", bounds: bool = True) -> int:
        """Append float32 values as substitutes: over a dense base of wrong values, or over zeros."""
        stored = np.asarray(values, "<f4")
        changed = np.flatnonzero((stored != 0).any(axis=1))
        index = self.accessor(np.where(stored != 0, 7.0, 0.0)) if base else self.append("accessors", {})
        described: Json = {"componentType": COMPONENTS["f4"], "count": len(stored), "type": TYPES[stored.shape[1]]}
        described["sparse"] = {
            "count": len(changed),
            "indices": {
                "bufferView": self.view(changed.astype(f"<{index_dtype}").tobytes()),
                "componentType": COMPONENTS[index_dtype],
            },
            "values": {"bufferView": self.view(stored[changed].tobytes())},
        }
        if bounds:
            described |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.gltf["accessors"][index] |= described
        return index

    def _describe(
        self, rows: Array, dtype: str, view: int, offset: int, *, normalized: bool, bounds: bool, **more: Any
    ) -> int:
        accessor: Json = {
            "bufferView": view,
            "componentType": COMPONENTS[dtype],
            "count": len(rows),
            "type": TYPES[rows.shape[1]],
            **more,
        }
        if offset:
            accessor["byteOffset"] = offset
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.append("accessors", accessor)

    def channel(
        self,
        animation: Json,
        node: int,
        path: str,
        times: Any,
        values: Any,
        interpolation: Interpolation = "LINEAR",
    ) -> None:
        """Append a channel to an animation; values are (keys, …), or (keys, 3, …) for CUBICSPLINE."""
        width = 1 if path == "weights" else np.shape(values)[-1]
        sampler = {
            "input": self.accessor(times, bounds=bool(np.isfinite(times).all())),
            "output": self.accessor(np.reshape(values, (-1, width))),
            "interpolation": interpolation,
        }
        animation.setdefault("samplers", []).append(sampler)
        target = {"node": node, "path": path}
        animation.setdefault("channels", []).append({"sampler": len(animation["samplers"]) - 1, "target": target})

    def glb(self) -> bytes:
        """The document as a .glb."""
        gltf = dict(self.gltf)
        if self.data:
            gltf["buffers"] = [{"byteLength": len(self.data)}, *gltf.get("buffers", [])[1:]]
        return pack_glb(json.dumps(gltf).encode(), bytes(self.data))

    def write(self, path: Path, *, buffer: Literal["file", "data", "percent", "folder"] = "file") -> Path:
        """Write the document; the ending decides between .glb and .gltf.

        Args:
            path: The file.
            buffer: Of a .gltf: a file beside it, a data URI, a file with a name to be percent-encoded, or a
                file in a folder below.
        """
        if path.suffix == ".glb":
            path.write_bytes(self.glb())
            return path
        name = {"file": f"{path.stem}.bin", "percent": "my büffer #1%.bin", "folder": "data/a.bin", "data": ""}[buffer]
        if name:
            (path.parent / name).parent.mkdir(exist_ok=True)
            (path.parent / name).write_bytes(self.data)
            uri = quote(name)
        else:
            uri = "data:application/gltf-buffer;base64," + base64.b64encode(self.data).decode()
        path.write_text(json.dumps({**self.gltf, "buffers": [{"uri": uri, "byteLength": len(self.data)}]}))
        return path


def pack_glb(text: bytes, binary: bytes = b"") -> bytes:
    """A .glb of a JSON chunk and a binary one, none where it is empty."""
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        binary += bytes(-len(binary) % 4)
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def read_glb(data: bytes) -> tuple[Json, bytes]:
    """The JSON and the binary chunk of a .glb, read without the code under test."""
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


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
    """Write a tools file (YAML that is JSON too), with the limb's default tool where none is given."""
    path.write_text(json.dumps({"version": 1, **header, "tools": list(tools) or [tool()]}))
    return path


@dataclass(frozen=True)
class Prepared:
    """An asset as the stages before the encoding see it."""

    document: Document
    rig: Rig
    surface: Surface
    clips: tuple[Clip, ...]
    settings: ToolsFile
    rest: Rest
    patches: list[Patch]

    @property
    def patch(self) -> Patch:
        """The only patch, or the first."""
        return self.patches[0]

    @property
    def clip(self) -> Clip:
        """The only clip, or the first."""
        return self.clips[0]

    def refined(self, *, tolerance: float = np.inf, contacts: Array | None = None, influences: int = 4) -> Refinement:
        """The refined surface; no edge is held back by its skin weights."""
        return refine(
            self.surface,
            self.rest,
            self.patches,
            self.rig,
            settings=self.settings.refinement,
            contacts=np.zeros(len(self.surface.positions), bool) if contacts is None else contacts,
            influences=influences,
            poses=joint_matrices(self.rig, None, np.zeros(1)),
            tolerance=tolerance,
        )


def as_document(asset: Asset) -> Document:
    """The document that reading the asset gives."""
    with TemporaryDirectory() as folder:
        return read_document(asset.write(Path(folder) / "limb.glb"))


def prepare(asset: Asset, *tools: Json, node: int = 0, **header: Any) -> Prepared:
    """Read an asset and attach tools to it, the limb's default tool where none is given."""
    document = as_document(asset)
    settings = parse_tools(json.dumps({"version": 1, **header, "tools": list(tools) or [tool()]}), name="tools.yaml")
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, list(settings.tools))
    patches = attach_tools(list(settings.tools), surface, rest, rig, settings, clips)
    return Prepared(document, rig, surface, clips, settings, rest, patches)
