"""Recognises the format of a file that was given in place of an asset or a tools file, for messages."""

import re

from wrinklecli.choices import EFFECTS
from wrinklecli.frozen import dataclass

MODEL_ENDINGS = (".glb", ".gltf", ".vrm")
"""Endings of files that are written as glTF; all but .gltf are in the container of a .glb."""

_EXPORT = "; open it in Blender, or in what made it, and export glTF (.glb)"
_UNPACK = "; unpack it first"
_STILL = ", which has neither skin nor clips"
_PICTURE = "a picture"


@dataclass(frozen=True, slots=True)
class _Format:
    """A format that people have in place of glTF.

    Attributes:
        what: Its name for messages, and what to do.
        endings: Endings of file names.
        starts: First bytes of files, in upper or lower case.
    """

    what: str
    endings: tuple[str, ...] = ()
    starts: tuple[bytes, ...] = ()


_FORMATS = (
    _Format("an FBX file" + _EXPORT, (".fbx",), (b"Kaydara FBX", b"; FBX")),
    _Format("a Blender file; export it there: File > Export > glTF 2.0 (.glb)", (".blend",), (b"BLENDER",)),
    _Format("a USD file" + _EXPORT, (".usd", ".usda", ".usdc", ".usdz"), (b"#usda", b"PXR-USDC")),
    _Format("a COLLADA file" + _EXPORT, (".dae",)),
    _Format("an Alembic file" + _EXPORT, (".abc",), (b"Ogawa",)),
    _Format("a Maya file" + _EXPORT, (".ma", ".mb"), (b"//Maya",)),
    _Format("a 3ds Max file" + _EXPORT, (".max",)),
    _Format("an OBJ file" + _STILL + _EXPORT, (".obj",)),
    _Format("a PLY file" + _STILL + _EXPORT, (".ply",), (b"ply\n", b"ply\r")),
    _Format("an STL file" + _STILL + _EXPORT, (".stl",)),
    _Format("a BVH file, which has no mesh" + _EXPORT, (".bvh",)),
    _Format(_PICTURE, (".png", ".jpg", ".jpeg", ".webp"), (b"\x89PNG", b"\xff\xd8\xff")),
    _Format("a ZIP archive" + _UNPACK, (".zip",), (b"PK\x03\x04",)),
    _Format("an archive" + _UNPACK, (".7z", ".rar", ".gz", ".tar"), (b"7z\xbc\xaf", b"Rar!", b"\x1f\x8b")),
    _Format(
        "a pointer of Git LFS, not the file itself; `git lfs pull` fetches that", (), (b"version https://git-lfs",)
    ),
    _Format("a web page; has a download failed?", (".html",), (b"<!DOCTYPE html", b"<html")),
)
# Bytes that contain the longest start.
_HEAD = 64


def is_gltf(data: bytes) -> bool:
    """True if a file seems to be a glTF asset, .glb or .gltf."""
    return data.startswith(b"glTF") or re.match(rb'(\xef\xbb\xbf)?\s*\{(?s:.*)"asset"\s*:\s*\{', data) is not None


def is_tools_file(data: bytes, name: str) -> bool:
    """True if a file seems to be a tools file or other YAML."""
    return (
        name.lower().endswith((".yaml", ".yml"))
        or re.search(rb"(?m)^(%s):" % "|".join(EFFECTS).encode(), data) is not None
    )


def foreign_format(data: bytes, name: str) -> str | None:
    """Name the format of a file that is no glTF, and what to do: `a ZIP archive; unpack it first`; None if unknown.

    The name's ending decides first, since several formats are archives, and then the first bytes.
    """
    head, name = data[:_HEAD].lstrip().lower(), name.lower()
    by_name = (each.what for each in _FORMATS if name.endswith(each.endings))
    by_start = (each.what for each in _FORMATS if head.startswith(tuple(start.lower() for start in each.starts)))
    return next(by_name, None) or next(by_start, None)
