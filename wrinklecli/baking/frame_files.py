"""Files of posed frames: an OBJ, PLY or GLB for each frame of each clip, all put into a folder or none."""

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from wrinklecli.baking.frames import Frames, PosedFrame, pose_frames
from wrinklecli.baking.refined_mesh import old_values, primitives_of
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.files import make_folders
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.guard import Progress

# The first line of the OBJ files that trimesh writes.
_OBJ_HEADER = "# https://github.com/mikedh/trimesh\n"


@contextmanager
def exported_frames(
    document: Document, every: Sequence[Frames], folder: str | os.PathLike[str], kind: str, progress: Progress
) -> Iterator[Callable[[], None]]:
    """Write a file for each frame of each clip, `CLIP_0001.obj`, with positions, normals and UVs, world space.

    Args:
        document: The source.
        every: The meshes, all with the same clips; a file holds one frame of them all.
        folder: Made where it is not there.
        kind: obj, ply or glb.
        progress: Called with a stage's name, frames done and frames in all.

    Yields:
        What puts the files into the folder; uncalled, or where anything fails later, all is left there as it was.

    Raises:
        BakeError: The folder cannot be written to.
    """
    target = Path(folder)
    made: list[str] = []
    try:
        made = make_folders(os.fspath(target))
        with tempfile.TemporaryDirectory(prefix=".wrinkle-", dir=target) as temporary:
            names = _write_frames(document, every, Path(temporary), kind, progress)
            with _moved_together(names, Path(temporary), target) as put:
                yield put
    except OSError as error:
        raise BakeError(f"cannot be written: {error.strerror or error}", where=os.fspath(folder)) from error
    finally:
        for each in reversed(made):
            with suppress(OSError):  # not empty: done
                os.rmdir(each)


@contextmanager
def _moved_together(names: Sequence[str], source: Path, target: Path) -> Iterator[Callable[[], None]]:
    """Yield what moves files from one folder to another; where anything fails later, they are taken back."""
    old = source / "old"
    old.mkdir()
    begun: list[str] = []

    def put() -> None:
        for name in names:
            begun.append(name)
            if (target / name).is_file():
                os.replace(target / name, old / name)
            os.replace(source / name, target / name)

    try:
        yield put
    except BaseException:
        for name in begun:
            if not (source / name).exists():
                os.unlink(target / name)
            if (old / name).exists():
                os.replace(old / name, target / name)
        raise


def _write_frames(
    document: Document, every: Sequence[Frames], folder: Path, kind: str, progress: Progress
) -> list[str]:
    """Write the frames' files; their names."""
    triangles, uvs = _joined_topology(document, every)
    write = (
        _obj_writer(triangles, uvs) if kind == "obj" else partial(_exported, triangles=triangles, uvs=uvs, kind=kind)
    )
    names: list[str] = []
    stems: set[str] = set()
    for motions in zip(*(frames.motions for frames in every), strict=True):
        stem = re.sub(r"[^A-Za-z0-9_.-]", "_", motions[0].clip.name)
        stem = stem if stem not in stems else f"{stem}_{motions[0].clip.index}"
        stems.add(stem)
        posed = [pose_frames(document, frames, motion) for frames, motion in zip(every, motions, strict=True)]
        for number, meshes in enumerate(zip(*posed, strict=True)):
            names.append(f"{stem}_{number:04d}.{kind}")
            (folder / names[-1]).write_bytes(write(meshes))
            progress("files", number + 1, len(motions[0].times))
    return names


def _joined_topology(document: Document, every: Sequence[Frames]) -> tuple[Ints, Floats | None]:
    """(triangles, 3) vertices of all meshes one after another, and (vertices, 2) UVs where every primitive has them."""
    triangles, uvs, start = [], [], 0
    for frames in every:
        primitives = document.items("meshes")[frames.rig.mesh]["primitives"]
        for primitive, refined in zip(primitives, primitives_of(frames.fine), strict=True):
            triangles.append(refined.triangles + start)
            start += len(refined.weld)
            if "TEXCOORD_0" in primitive["attributes"]:
                old = old_values(document, primitive["attributes"], "TEXCOORD_0", refined, size=2)
                uvs.append(np.concatenate([old, refined.mix(old)]))
    complete = sum(len(each) for each in uvs) == start
    # glTF counts v from the top of the image, the other formats from the bottom.
    return np.concatenate(triangles), np.concatenate(uvs) * [1.0, -1.0] + [0.0, 1.0] if complete else None


def _obj_writer(triangles: Ints, uvs: Floats | None) -> Callable[[Sequence[PosedFrame]], bytes]:
    """What makes the text of an OBJ from a frame: trimesh's, without the material file that it names.

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
    """A line for each of (rows, numbers): its kind and values, each of as many numbers as it has places."""
    values = " ".join([value] * (rows.shape[1] // value.count("%")))
    return f"{kind} {values}\n" * len(rows) % tuple(rows.reshape(-1).tolist())


def _joined_frame(frame: Sequence[PosedFrame]) -> tuple[Floats, Floats | None]:
    """(vertices, 3) positions of all meshes one after another, and normals where every mesh has them."""
    normals = [mesh.normals for mesh in frame if mesh.normals is not None]
    positions = np.concatenate([mesh.positions for mesh in frame])
    return positions, np.concatenate(normals) if len(normals) == len(frame) else None


def _exported(frame: Sequence[PosedFrame], triangles: Ints, uvs: Floats | None, kind: str) -> bytes:
    """A frame in a format of trimesh's."""
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
