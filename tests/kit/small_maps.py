"""Wrinkle maps of few texels where a bake writes them with the defaults, which take half a minute."""

from contextlib import AbstractContextManager
from functools import partial
from typing import Any
from unittest import mock

from wrinklecli.texture.maps import MapOptions


def small_maps(size: int = 16) -> AbstractContextManager[Any]:
    """A block in which a bake's maps have so many texels a side."""
    return mock.patch("wrinklecli.texture.maps.MapOptions", partial(MapOptions, size=size))
