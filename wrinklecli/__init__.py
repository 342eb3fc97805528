"""Dynamic wrinkles for animated glTF characters, baked: `wrinklecli.bake(asset, tools, out)`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrinklecli.baking.job import BakeOptions as BakeOptions
    from wrinklecli.baking.pipeline import bake as bake

__all__ = ["BakeOptions", "bake"]


def __getattr__(name: str) -> Any:
    # Lazily: importing the package for `wrinkle --help` must not import numpy.
    if name == "bake":
        from wrinklecli.baking.pipeline import bake

        return bake
    if name == "BakeOptions":
        from wrinklecli.baking.job import BakeOptions

        return BakeOptions
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
