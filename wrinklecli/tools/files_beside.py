"""The text of tools files, and the files that they name: images of masks, and files of presets."""

import os
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO

from wrinklecli.errors import ConfigError
from wrinklecli.files.claims import is_path
from wrinklecli.files.formats import is_gltf
from wrinklecli.files.inputs import lies_below, open_input
from wrinklecli.tools.yaml_tree import MAX_BYTES, printable, read_tree


def load_text(path: str | os.PathLike[str]) -> str:
    """Read the text of a file of tools or presets.

    Raises:
        ConfigError: The file cannot be read, or is no text.
    """
    name = os.fspath(path)
    shown_name = printable(name, len(name))
    try:
        with open_input(path) as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror or error}", where=shown_name) from None
    if is_gltf(data):
        message = "is a glTF asset, where the tools file (YAML) belongs: the asset comes first, then the tools"
        raise ConfigError(message, where=shown_name)
    if len(data) > MAX_BYTES:
        raise ConfigError(f"larger than {MAX_BYTES // 1_000_000} MB, expected YAML", where=shown_name)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"found byte 0x{data[error.start]:02x}, expected UTF-8"
        raise ConfigError(message, where=f"{shown_name}:{line}") from None


def path_beside(file: str, path: str, *, external: bool) -> str | None:
    """The path that a tools file names; None if it is none, or leaves the file's folder without `external`."""
    folder = os.path.dirname(file)
    found = os.path.join(folder, path)
    return found if is_path(path) and (external or lies_below(found, folder)) else None


def files_beside(file: BinaryIO) -> list[str]:
    """List the images and presets that an open tools file names, as it writes them; none if it is no YAML."""
    data = file.read(MAX_BYTES)
    # Parsing takes far longer. An escape may spell a key in another way.
    if not any(each in data for each in (b"mask", b"presets", b"\\")):
        return []
    try:
        root, _ = read_tree(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        return []
    named = () if root is None else _named(root.value)
    paths = (each for each in named if isinstance(each, str) and each and is_path(each))
    return [*dict.fromkeys(paths)]


def with_files_beside(paths: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Give tools files and the files that they name; a file that cannot be read names none."""
    for each in paths:
        path = os.fspath(each)
        yield path
        try:
            with open_input(path) as file:
                named = files_beside(file)
        except OSError:
            continue
        yield from (os.path.join(os.path.dirname(path), name) for name in named)


def _named(value: Any) -> Iterator[Any]:
    """Names of files that a tools file gives, which may be anything."""
    if not isinstance(value, dict):
        return
    presets = value.get("presets")
    yield from presets if isinstance(presets, list) else [presets]
    entries = presets.values() if isinstance(presets, dict) else ()
    effects = (each for listed in value.values() if isinstance(listed, list) for each in listed)
    for holder in (value.get("defaults"), *entries, *effects):
        mask = holder.get("mask") if isinstance(holder, dict) else None
        yield mask.get("image") if isinstance(mask, dict) else None
