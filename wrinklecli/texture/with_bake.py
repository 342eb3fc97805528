"""A bake and its wrinkle maps in one step, as `wrinkle bake --maps-dir` and `wrinkle batch` do it."""

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from wrinklecli.baking.job import BakeOptions, ToolsPaths
from wrinklecli.baking.pipeline import bake
from wrinklecli.baking.report import Report
from wrinklecli.errors import refuse_warnings
from wrinklecli.files.outputs import Outputs
from wrinklecli.numeric.guard import Progress, log_progress

if TYPE_CHECKING:
    from wrinklecli.texture.maps import Maps


def bake_with_maps(
    asset: str | os.PathLike[str],
    tools: ToolsPaths,
    out: str | os.PathLike[str] | None,
    maps_dir: str | None,
    options: BakeOptions,
    *,
    outputs: Outputs,
    progress: Progress = log_progress,
) -> "tuple[Report, Maps | None]":
    """Bake as `bake` does, and write maps into a folder with the defaults of `maps`; None for no folder.

    The data of the report then have the record of the maps.

    Raises:
        WrinkleError: As of `bake` and `maps`; what is wrong with the folder is found before the bake. With `strict`,
            warnings of either are a RefusedError.
    """
    if maps_dir is None:
        return bake(asset, tools, out, options, outputs=outputs, progress=progress), None
    from wrinklecli.texture.maps import MapOptions, claim_maps, make_maps

    claim_maps(maps_dir, outputs)
    baked = bake(asset, tools, out, options, outputs=outputs, progress=progress)
    shared = {name: getattr(options, name) for name in ("only", "anims", "allow_external", "max_memory")}
    mapped = make_maps(asset, tools, maps_dir, MapOptions(**shared), outputs, progress)
    if options.strict:
        refuse_warnings(mapped.warnings, where=os.fspath(asset))
    return replace(baked, data={**baked.data, "maps": mapped.record}), mapped
