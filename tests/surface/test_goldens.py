"""Goldens: what colours, names and parts of the body say of a substance is as it was."""

from itertools import product
from typing import get_args

import numpy as np

from kit.golden import Golden, summed
from wrinklecli.choices import Part
from wrinklecli.surface.substance import BareSkin, PrimitiveHints, _by_looks, _soft, named
from wrinklecli.surface.swatch import Swatches

KINDS = ("skin", "cloth", "leather", "hard")


def test_substances_are_judged_as_before(golden: Golden) -> None:
    """Colours all over Oklab, of two points each, with and without a picture and bare skin."""
    steps = np.linspace(0.15, 0.95, 9), (0.0, 0.016, 0.03, 0.08, 0.15), np.radians(np.arange(15.0, 360.0, 23.0))
    lightness, chroma, hue = np.array([*product(*steps)]).T
    colours = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=1)
    numbers = np.arange(len(colours))
    swatches = Swatches(
        np.stack([colours, 0.9 * colours], axis=1), numbers % 2 * 1.0, (numbers % 11 > 0) * 1.0, 0.0 * numbers
    )
    bare = BareSkin(np.array([0.6, 0.05, 0.07]))
    every = [_by_looks(swatches, each) for each in (None, bare)]
    looks = [np.array([[each.get(kind, 0.0) for kind in KINDS] for each in found]) for found in every]
    words = [None, *(named([name], "it") for name in ("shirt", "Boots_01", "HairBand", "flesh", "wolf fur"))]
    parts = (None, *get_args(Part))
    judged = [
        _soft(PrimitiveHints(material, node, None), {"by its texture": look}, parts[number % len(parts)], unshod=False)
        for number, (look, (material, node)) in enumerate(zip(every[1], [*product(words, words)] * 30, strict=False))
    ]
    kinds = [KINDS.index(each.kind) for each in judged]
    told = [each.why for each in judged]
    golden(
        [
            *(summed(each) for each in looks),
            summed(np.array(kinds)),
            summed(np.array([each.confidence for each in judged])),
            {why: told.count(why) for why in dict.fromkeys(told)},
        ],
        "substances.json",
    )
