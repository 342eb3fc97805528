"""Files of posed frames: an OBJ, PLY or GLB for each frame of each clip."""

import os
import re
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import chain
from typing import Any, cast

import numpy as np

from wrinklecli.baking.frames import PosedFrame, pose_frames
from wrinklecli.baking.refined_mesh import old_values, primitives_of
from wrinklecli.baking.report import BakedMesh
from wrinklecli.character.clip import Clip
from wrinklecli.files.outputs import Outputs
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.guard import Progress

# The first line of the OBJ files that trimesh writes.
_OBJ_HEADER = "# https://github.com/mikedh/trimesh\n"


def export_frames(
    document: Document,
    meshes: Sequence[BakedMesh],
    folder: str | os.PathLike[str],
    kind: str,
    outputs: Outputs,
    progress: Progress,
) -> None:
    """Write a file for each frame of each clip, `CLIP_0001.obj`, with positions, normals and UVs, world space.

    Args:
        document: The source.
        meshes: All have the same clips; a file holds one frame of them all.
        folder: It is made if it is missing.
        kind: obj, ply or glb.
        outputs: The files are added to these.
        progress: Called with a stage's name, frames done and frames in all.

    Raises:
        BakeError: The folder cannot be written to, or a file would be another output or an input.
    """
    outputs.make_folders(folder)
    clips = list(zip(*(mesh.motions for mesh in meshes), strict=True))
    paths = [
        [os.path.join(folder, f"{stem}_{number:04d}.{kind}") for number in range(len(motions[0].times))]
        for stem, motions in zip(_stems([motions[0].clip for motions in clips]), clips, strict=True)
    ]
    for path in chain.from_iterable(paths):
        outputs.claim(path)
    triangles, uvs = _joined_topology(document, meshes)
    encode = (
        _obj_writer(triangles, uvs) if kind == "obj" else partial(_exported, triangles=triangles, uvs=uvs, kind=kind)
    )
    for motions, own in zip(clips, paths, strict=True):
        posed = [pose_frames(document, mesh, motion) for mesh, motion in zip(meshes, motions, strict=True)]
        for number, (path, frame) in enumerate(zip(own, zip(*posed, strict=True), strict=True)):
            outputs.add_bytes(path, encode(frame), durable=False)
            progress("files", number + 1, len(own))


def _stems(clips: Sequence[Clip]) -> list[str]:
    """The beginnings of the names of each clip's files: the clip's name, with its number if another has that name."""
    stems: dict[str, None] = {}
    for clip in clips:
        stem = re.sub(r"[^A-Za-z0-9_.-]", "_", clip.name)
        while stem in stems:
            stem = f"{stem}_{clip.index}"
        stems[stem] = None
    return list(stems)


def _joined_topology(document: Document, meshes: Sequence[BakedMesh]) -> tuple[Ints, Floats | None]:
    """(triangles, 3) vertices of all meshes one after another, and (vertices, 2) UVs if every primitive has them."""
    triangles, uvs, start = [], [], 0
    for mesh in meshes:
        primitives = document.items("meshes")[mesh.plan.rig.mesh]["primitives"]
        for primitive, refined in zip(primitives, primitives_of(mesh.plan.fine), strict=True):
            triangles.append(refined.triangles + start)
            start += len(refined.weld)
            if "TEXCOORD_0" in primitive["attributes"]:
                old = old_values(document, primitive["attributes"], "TEXCOORD_0", refined, size=2)
                uvs.append(np.concatenate([old, refined.mix(old)]))
    complete = sum(len(each) for each in uvs) == start
    # glTF counts v from the top of the image, the other formats from the bottom.
    return np.concatenate(triangles), np.concatenate(uvs) * [1.0, -1.0] + [0.0, 1.0] if complete else None


def _obj_writer(triangles: Ints, uvs: Floats | None) -> Callable[[Sequence[PosedFrame]], bytes]:
    """A function from a frame to the text of an OBJ: that of trimesh, without the material file that it names.

    The lines of UVs and faces, more than half of a file, are the same in all frames and made once.
    """

    @cache
    def unchanging(with_normals: bool) -> str:
        # A corner's vertex, UV and normal have one number.
        corner = {(False, False): "%d", (True, False): "%d/%d", (False, True): "%d//%d", (True, True): "%d/%d/%d"}[
            uvs is not None, with_normals
        ]
        numbers = np.repeat(triangles + 1, corner.count("%d"), axis=1)
        return ("" if uvs is None else _lines("vt", uvs)) + _lines("f", numbers, value=corner)

    def write(frame: Sequence[PosedFrame]) -> bytes:
        positions, normals = _joined_frame(frame)
        moving = _lines("v", positions) + ("" if normals is None else _lines("vn", normals))
        return f"{_OBJ_HEADER}{moving}{unchanging(normals is not None)}\n".encode()

    return write


def _lines(kind: str, rows: Floats | Ints, *, value: str = "%.8f") -> str:
    """A line for each of (rows, numbers): its kind, then values of as many numbers as `value` has places."""
    values = " ".join([value] * (rows.shape[1] // value.count("%")))
    return f"{kind} {values}\n" * len(rows) % tuple(rows.reshape(-1).tolist())


def _joined_frame(frame: Sequence[PosedFrame]) -> tuple[Floats, Floats | None]:
    """(vertices, 3) positions of all meshes one after another, and normals if every mesh has them."""
    normals = [mesh.normals for mesh in frame if mesh.normals is not None]
    positions = np.concatenate([mesh.positions for mesh in frame])
    return positions, np.concatenate(normals) if len(normals) == len(frame) else None


def _exported(frame: Sequence[PosedFrame], triangles: Ints, uvs: Floats | None, kind: str) -> bytes:
    """A frame in a format that trimesh writes."""
    import trimesh

    positions, normals = _joined_frame(frame)
    mesh: Any = trimesh.Trimesh(
        positions,
        triangles,
        vertex_normals=normals,
        visual=None if uvs is None else cast(Any, trimesh.visual.TextureVisuals)(uv=uvs),
        process=False,
        validate=False,
    )
    with_normals = {"vertex_normal" if kind == "ply" else "include_normals": normals is not None}
    data = mesh.export(file_type=kind, **with_normals)
    return data.encode() if isinstance(data, str) else bytes(data)
