"""Dynamic wrinkles for animated glTF characters, baked: `wrinklecli.bake(asset, tools, out)`."""

TYPE_CHECKING = False  # `typing` takes longer than all else before Ctrl-C is handled
if TYPE_CHECKING:
    from typing import Any

    from wrinklecli.baking.job import BakeOptions as BakeOptions
    from wrinklecli.baking.pipeline import bake as bake
    from wrinklecli.baking.track import TrackOptions as TrackOptions
    from wrinklecli.baking.track import track as track
    from wrinklecli.batching.batch import BatchOptions as BatchOptions
    from wrinklecli.batching.batch import batch as batch
    from wrinklecli.errors import WrinkleError as WrinkleError
    from wrinklecli.example.demo import demo as demo
    from wrinklecli.review.check import CheckOptions as CheckOptions
    from wrinklecli.review.check import check as check
    from wrinklecli.review.crossings import crossings as crossings
    from wrinklecli.review.diff.diff import DiffOptions as DiffOptions
    from wrinklecli.review.diff.diff import diff as diff
    from wrinklecli.review.inspect import InspectOptions as InspectOptions
    from wrinklecli.review.inspect import inspect as inspect
    from wrinklecli.review.preview.preview import preview as preview
    from wrinklecli.review.preview.preview_options import PreviewOptions as PreviewOptions
    from wrinklecli.review.preview.preview_options import Style as Style
    from wrinklecli.review.suggest.suggest import suggest as suggest
    from wrinklecli.review.suggest.suggest_options import SuggestOptions as SuggestOptions
    from wrinklecli.texture.maps import MapOptions as MapOptions
    from wrinklecli.texture.maps import maps as maps
    from wrinklecli.tools.records import Length as Length

# The module of each name. They are imported when a name is used, since `wrinkle --help` must not import numpy.
_MODULES = {
    "BakeOptions": "baking.job",
    "BatchOptions": "batching.batch",
    "CheckOptions": "review.check",
    "DiffOptions": "review.diff.diff",
    "InspectOptions": "review.inspect",
    "Length": "tools.records",
    "MapOptions": "texture.maps",
    "PreviewOptions": "review.preview.preview_options",
    "Style": "review.preview.preview_options",
    "SuggestOptions": "review.suggest.suggest_options",
    "TrackOptions": "baking.track",
    "WrinkleError": "errors",
    "bake": "baking.pipeline",
    "batch": "batching.batch",
    "check": "review.check",
    "crossings": "review.crossings",
    "demo": "example.demo",
    "diff": "review.diff.diff",
    "inspect": "review.inspect",
    "maps": "texture.maps",
    "preview": "review.preview.preview",
    "suggest": "review.suggest.suggest",
    "track": "baking.track",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> "Any":
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"wrinklecli.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
