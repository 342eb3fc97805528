"""What a file is that stands where an asset or a tools file belongs, in words for those who gave it."""

import re
from dataclasses import dataclass

_EXPORT = "; open it in Blender, or in what made it, and export glTF (.glb)"
_UNPACK = "; unpack it first"
_STILL = ", which has neither skin nor clips"
_PICTURE = "a picture"


@dataclass(frozen=True, slots=True)
class _Format:
    """A format that people have in the place of glTF.

    Attributes:
        what: It is, and what to do.
        endings: Of the names of its files.
        starts: First bytes of its files, in any case of letters.
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
_HEAD = 64  # bytes that hold the longest start


def is_gltf(data: bytes) -> bool:
    """Whether a file seems to be a glTF asset, .glb or .gltf."""
    return data.startswith(b"glTF") or re.match(rb'(\xef\xbb\xbf)?\s*\{(?s:.*)"asset"\s*:\s*\{', data) is not None


def is_tools_file(data: bytes, name: str) -> bool:
    """Whether a file seems to be one of wrinkling tools, or other YAML."""
    return name.lower().endswith((".yaml", ".yml")) or re.search(rb"(?m)^tools:", data) is not None


def foreign_format(data: bytes, name: str) -> str | None:
    """What a file is that is no glTF, and what to do, such as `a ZIP archive; unpack it first`; None where unknown.

    By the end of its name, since archives hold several formats, and then by its first bytes.
    """
    head, name = data[:_HEAD].lstrip().lower(), name.lower()
    by_name = (each.what for each in _FORMATS if name.endswith(each.endings))
    by_start = (each.what for each in _FORMATS if head.startswith(tuple(start.lower() for start in each.starts)))
    return next(by_name, None) or next(by_start, None)
