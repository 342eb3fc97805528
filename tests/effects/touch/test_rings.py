"""Rings of wrinkles: their heights are those of a control curve, on each ray, at any slide."""

from functools import cache

import numpy as np
import pytest

from kit.bakes import bake_once, place
from kit.touch import GRIP, plate, touch
from wrinklecli.character.clip import read_clips
from wrinklecli.effects.plan import attach_effects
from wrinklecli.effects.touch.attach import AttachedTouch
from wrinklecli.gltf.document import read_document
from wrinklecli.surface.ground import read_ground
from wrinklecli.tools.read import read_values


@cache
def attached(directions: int) -> AttachedTouch:
    values = {"version": 1, "touches": [touch(wrinkles={"bumps": 5, "directions": directions})]}
    settings = read_values({**values, "refinement": {"max_levels": 2}})
    document = read_document(place(plate()))
    ground = read_ground(document, 0, settings.effects, settings, read_clips(document))
    (found,) = attach_effects(ground, settings.effects, settings)[1]
    assert isinstance(found, AttachedTouch)
    return found


@pytest.mark.slow
def test_each_ring_keeps_the_length_of_the_skin() -> None:
    """At the greatest slide the arc over a ring is what its tissue has not taken up."""
    rings = attached(8).rings
    assert rings is not None
    spans = rings.length * np.diff(rings.edges)
    absorbed = (1.0 - rings.compressible) * rings.shares * GRIP
    excess = rings.profile.excess(rings.amplitudes[:, None], (spans - absorbed) / 2.0)
    assert excess == pytest.approx(absorbed, rel=1e-6)
    assert (np.diff(rings.shares) < 0).all()
    # All of the slide is taken up in the end: what is left behind the last ring fades over the reach.
    assert 0.5 < rings.shares.sum() < 1.0


@pytest.mark.quick(1)
@pytest.mark.parametrize(("directions", "error"), [(16, 0.03), (8, 0.12)])
def test_heights_are_those_of_the_control_curve_on_each_ray(directions: int, error: float) -> None:
    """Root mean square over rays and rings, relative to the tallest ring, at slides of any length and direction."""
    found = attached(directions)
    rings, drive = found.rings, found.drive
    assert rings is not None
    rays = np.linspace(-np.pi, np.pi, 361)
    for angle in np.linspace(0.0, np.pi / 4, 7):
        for part in (0.2, 0.5, 1.0):
            slide = part * GRIP * np.array([[np.cos(angle), np.sin(angle), 0.0]])
            weights = drive.weights_of_contacts(slide)[0, len(drive.slides) :]
            played = np.multiply.outer(rings.amplitudes, weights @ rings.windows(rays))
            spans = rings.length * np.diff(rings.edges)
            absorbed = (1.0 - rings.compressible) * rings.shares * GRIP * part
            wanted = rings.profile.amplitudes(absorbed, (spans - absorbed) / 2.0, np.inf)[:, 0]
            wanted = np.multiply.outer(wanted, np.maximum(np.cos(rays - angle), 0.0))
            assert np.sqrt(((played - wanted) ** 2).mean()) < error * wanted.max()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("directions", "error"), [(16, 0.03), (8, 0.12)])
def test_the_skin_rises_as_the_control_curve_does(directions: int, error: float) -> None:
    """The vertices themselves, root mean square over those that lie on rings, relative to the tallest."""
    values = {"touches": [touch(wrinkles={"bumps": 5, "directions": directions})], "refinement": {"max_levels": 3}}
    file = bake_once(place(plate()), top=values)
    found = attached(directions)
    rings, drive = found.rings, found.drive
    assert rings is not None
    positions, deltas = file.attribute("skin", "POSITION"), file.deltas("skin")[len(drive.slides) :, :, 1]
    distances, rays = found.places[0].place.polar(positions)
    u = (distances - rings.start) / rings.length
    on = (u > 0) & (u < 1)
    assert on.sum() > 2000
    for angle, part in ((0.0, 1.0), (np.pi / 8, 1.0), (2.0, 0.4)):
        weights = drive.weights_of_contacts(part * GRIP * np.array([[np.cos(angle), np.sin(angle), 0.0]]))[
            0, len(drive.slides) :
        ]
        played = weights @ deltas[: len(weights)]
        spans = rings.length * np.diff(rings.edges)
        absorbed = (1.0 - rings.compressible) * rings.shares * GRIP * part
        amplitudes = rings.profile.amplitudes(absorbed, (spans - absorbed) / 2.0, np.inf)[:, 0]
        which = np.clip(np.searchsorted(rings.edges, u, "right") - 1, 0, len(spans) - 1)
        shape = rings.profile.shapes(np.clip((u - rings.edges[which]) / np.diff(rings.edges)[which], 0.0, 1.0))[0]
        wanted = amplitudes[which] * shape * np.maximum(np.cos(rays - angle), 0.0)
        assert np.sqrt(((played - wanted)[on] ** 2).mean()) < error * wanted[on].max()


def test_windows_share_every_direction() -> None:
    rings = attached(8).rings
    assert rings is not None
    assert rings.windows(np.linspace(-4.0, 4.0, 100)).sum(axis=0) == pytest.approx(1.0)
