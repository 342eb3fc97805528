"""What a job depends on, by content: from that a key, under which a cache knows its outputs.

Times, folders and names of inputs do not matter; what is in them does, and who bakes them.
"""

import hashlib
import json
import os
import struct
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from typing import Any, BinaryIO, TypeAlias

import wrinklecli
from wrinklecli.batch import stores
from wrinklecli.batch.jobs import BatchJob
from wrinklecli.batch.manifest_schema import OPTION_KEYS
from wrinklecli.errors import AssetError
from wrinklecli.gltf.uris import path_of

Parts: TypeAlias = dict[str, Any]
"""What a key is made from, by what it is, as JSON values."""

# Of a .glb (glTF 2.0, §4.4): magic, version, length; length and kind of the JSON chunk.
_HEADER = struct.Struct("<4sIIII")
_MOST_JSON = 2**28  # bytes; the bake refuses what is larger before
_MISSING = "missing"
# The first two are told by what is in them; a bake that took more memory was refused, and makes nothing else of more.
_NO_OPTIONS = ("anim", "frames_dir", "max_memory")
_NAMES = ("out", "report", "timings")


@cache
def program() -> str:
    """The version of this program: its number, and a digest of its source, which has the method's number too."""
    folder = os.path.dirname(wrinklecli.__file__)
    digest = hashlib.sha256()
    for path in sorted(os.path.join(top, name) for top, _, names in os.walk(folder) for name in names):
        if path.endswith(".py"):
            with open(path, "rb") as file:
                digest.update(file.read())
    return f"{version('wrinklecli')}+{digest.hexdigest()[:16]}"


def parts_of(job: BatchJob, asked: BatchJob) -> Parts:
    """What the outputs of a job depend on.

    Args:
        job: Whose inputs are files here.
        asked: The same as it was asked for.

    Raises:
        AssetError: One cannot be read.
    """
    external = bool(job.options.get("allow_external", False))
    options = {
        key: value
        for key, value in job.options.items()
        if key not in _NO_OPTIONS and value != OPTION_KEYS[key].get("default")
    }
    parts: Parts = {
        "program": program(),
        "asset": asset_digests(job.asset, external=external),
        "tools": [_digest(path) for path in job.tools],
        "anim": [asset_digests(path, external=external) for path in job.options.get("anim", ())],
        "anims": [[os.path.basename(path), asset_digests(path, external=external)] for path in job.anims],
        "options": {**options, "frames": "frames_dir" in job.options},
        "names": {name: os.path.basename(getattr(job, name) or "") for name in _NAMES},
    }
    if job.report:  # it tells of them as they were given
        parts["names"]["given"] = [asked.asset, *asked.tools]
    return parts


def key_of(parts: Parts) -> str:
    """The key that parts make."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def difference(old: Parts | None, new: Parts) -> str:
    """Why a job has to be baked, though its output was baked before: what has changed, in words."""
    if old is None:
        return "new"
    words = {"program": "wrinkle", "asset": "the asset", "tools": "the tools", "anim": "clips", "anims": "clips"}
    changed = [words.get(part, part) for part in new if old.get(part) != new[part]]
    return f"{', '.join(dict.fromkeys(changed))} changed" if changed else "the cache has lost it"


def asset_digests(path: str, *, external: bool) -> dict[str, str]:
    """Digests of a glTF asset and of every file that it refers to, by URI; its own is under an empty one.

    Raises:
        AssetError: The asset cannot be read. Of another file, that is for the bake to say.
    """
    found = {"": _digest(path)}
    with stores.opened(path) as file:
        uris = references(file)
    for uri in uris:
        place = _beside(path, uri, external=external)
        try:
            found[uri] = _digest(place) if place else _MISSING
        except AssetError:
            found[uri] = _MISSING
    return found


def references(file: BinaryIO) -> list[str]:
    """The URIs of buffers and images of an open glTF file; none where it cannot be understood."""
    try:
        head = file.read(_HEADER.size)
        if head.startswith(b"glTF"):
            text = file.read(min(_HEADER.unpack(head)[3], _MOST_JSON))
        else:
            text = head + file.read(_MOST_JSON)
        return list(dict.fromkeys(_uris(json.loads(text))))
    except (ValueError, struct.error, RecursionError, AttributeError, TypeError):
        return []


def _uris(gltf: Any) -> Iterator[str]:
    for each in (*gltf.get("buffers", ()), *gltf.get("images", ())):
        uri = each.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            yield uri


def _beside(asset: str, uri: str, *, external: bool) -> str | None:
    """The file that a URI of an asset names; none that a bake would not read."""
    try:
        path = path_of(uri)
    except ValueError:
        return None
    outside = os.path.isabs(path) or os.path.normpath(path).split(os.sep)[0] == os.pardir
    return None if outside and not external else os.path.join(os.path.dirname(asset), path)


def _digest(path: str) -> str:
    try:
        with stores.opened(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise AssetError(f"cannot be read: {reason}", where=path) from error
