"""Several tools files as one: their tools together, what stands beside them where no two say otherwise."""

import os
from collections.abc import Sequence
from dataclasses import replace

from wrinklecli.errors import ConfigError
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import ToolsFile, identifier

# What stands beside the tools and holds for all of them; `up` is in the positions, which are Y-up once read.
_SHARED = ("rest", "sampling", "refinement")


def load_merged(paths: Sequence[str | os.PathLike[str]]) -> ToolsFile:
    """Read several files of tools for one asset.

    Args:
        paths: The files. The first gives the result its name and its `up`, in which results are shown.

    Raises:
        ConfigError: All problems of the files; or two have a tool of one name, or differ in what stands beside tools.
    """
    files, problems = [], []
    for path in paths:
        try:
            files.append(load_tools(path))
        except ConfigError as error:
            problems.append(error)
    if problems:
        raise ConfigError.of_all(problems)
    merged = files[0]
    for each in files[1:]:
        problems += _differences(merged, each)
        said = {key: getattr(each, key) for key in _SHARED if (key,) in each.places}
        merged = replace(
            merged,
            **said,
            tools=(*merged.tools, *each.tools),
            places={**merged.places, **{keys: place for keys, place in each.places.items() if keys[0] in said}},
            beside=(*merged.beside, each.path),
        )
    if problems:
        raise ConfigError.of_all(problems)
    return merged


def _differences(merged: ToolsFile, other: ToolsFile) -> list[ConfigError]:
    """Why a file cannot be merged with those before it."""
    problems = []
    for key in _SHARED:
        both = (key,) in merged.places and (key,) in other.places
        if both and getattr(merged, key) != getattr(other, key):
            message = f"differs from {merged.place(key)}, with which it is merged: they must agree"
            problems.append(ConfigError(message, where=other.place(key)))
    names = {identifier(tool.name): tool for tool in merged.tools}
    for tool in other.tools:
        if (taken := names.get(identifier(tool.name))) is not None:
            message = f"found {tool.name!r}, but {taken.where} has that name: files that are merged need names apart"
            problems.append(ConfigError(message, where=tool.place("name")))
    return problems
