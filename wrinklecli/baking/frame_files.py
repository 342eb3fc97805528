"""Files of posed frames: an OBJ, PLY or GLB for each frame of each clip, all put into a folder or none."""

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
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
            names = _export(document, every, Path(temporary), kind, progress)

            old = Path(temporary) / "old"
            old.mkdir()
            put_there: list[str] = []

            def put() -> None:
                for name in names:
                    put_there.append(name)
                    if (target / name).is_file():
                        os.replace(target / name, old / name)
                    os.replace(Path(temporary) / name, target / name)

            try:
                yield put
            except BaseException:
                for name in put_there:
                    if not (Path(temporary) / name).exists():
                        os.unlink(target / name)
                    if (old / name).exists():
                        os.replace(old / name, target / name)
                raise
    except OSError as error:
        raise BakeError(f"cannot be written: {error.strerror or error}", where=os.fspath(folder)) from error
    finally:
        for each in reversed(made):
            with suppress(OSError):  # not empty: done
                os.rmdir(each)


def _export(document: Document, every: Sequence[Frames], folder: Path, kind: str, progress: Progress) -> list[str]:
    """Write the frames' files; their names."""
    write = _writer(*_joined_topology(document, every), kind)
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
        for primitive, part in zip(primitives, primitives_of(frames.fine), strict=True):
            triangles.append(part.triangles + start)
            start += len(part.weld)
            if "TEXCOORD_0" in primitive["attributes"]:
                old = old_values(document, primitive["attributes"], "TEXCOORD_0", part, size=2)
                uvs.append(np.concatenate([old, part.mix(old)]))
    complete = sum(len(each) for each in uvs) == start
    # glTF counts v from the top of the image, the other formats from the bottom.
    return np.concatenate(triangles), np.concatenate(uvs) * [1.0, -1.0] + [0.0, 1.0] if complete else None


def _writer(triangles: Ints, uvs: Floats | None, kind: str) -> Callable[[Sequence[PosedFrame]], bytes]:
    """What makes a file of a frame, in a format of trimesh's.

    In OBJ, which is text, all frames have the lines of UVs and faces of the first: writing them takes most of the time.
    """
    constant = ""

    def write(frame: Sequence[PosedFrame]) -> bytes:
        nonlocal constant
        if kind != "obj":
            return _exported(frame, triangles, uvs, kind)
        if not constant:
            # trimesh names a material file that is not written here.
            text = re.sub(r"(?m)^(?:mtllib|usemtl) .*\n", "", _exported(frame, triangles, uvs, kind).decode())
            first = re.search(r"(?m)^(?:vt|f) ", text)
            constant = text[first.start() if first else len(text) :] + "\n" * (not text.endswith("\n"))
        # Without triangles and UVs these are the vertices, and a face of nothing.
        vertices, _, _ = _exported(frame, triangles[:0], None, kind).decode().partition("\nf ")
        return f"{vertices}\n{constant}".encode()

    return write


def _exported(frame: Sequence[PosedFrame], triangles: Ints, uvs: Floats | None, kind: str) -> bytes:
    import trimesh

    normals = [mesh.normals for mesh in frame if mesh.normals is not None]
    complete = len(normals) == len(frame)
    mesh: Any = trimesh.Trimesh(
        np.concatenate([mesh.positions for mesh in frame]),
        triangles,
        vertex_normals=np.concatenate(normals) if complete else None,
        visual=None if uvs is None else cast(Any, trimesh.visual.TextureVisuals)(uv=uvs),
        process=False,
        validate=False,
    )
    data = mesh.export(file_type=kind, **{"vertex_normal" if kind == "ply" else "include_normals": complete})
    return data.encode() if isinstance(data, str) else bytes(data)
