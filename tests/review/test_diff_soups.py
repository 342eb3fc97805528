"""Surfaces of other triangles over time: the greatest distance is that of all times looked at one by one."""

import numpy as np
import pytest

from kit.asset import Asset
from kit.bakes import place
from kit.limb import limb_asset
from wrinklecli.character.clip import read_clips
from wrinklecli.character.scene import read_scene
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.closest import on_triangles
from wrinklecli.review.diff.soups import Soup, farthest_apart


def soup(asset: Asset) -> Soup:
    document = read_document(place(asset))
    return Soup.of(read_scene(document), read_clips(document)[0])


def farthest(points: Floats, corners: Floats) -> float:
    """The greatest distance of (points, 3) from (triangles, 3, 3), by all pairs."""
    pairs = np.repeat(points, len(corners), axis=0), np.tile(corners, (len(points), 1, 1))
    away = np.linalg.norm(on_triangles(*pairs)[1] - pairs[0], axis=1)
    return float(away.reshape(len(points), -1).min(axis=1).max())


@pytest.mark.parametrize("rings", [9, 10])
def test_the_farthest_vertex_of_all_times_is_found(rings: int) -> None:
    a = soup(limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR"))
    b = soup(limb_asset(rings=rings, sides=7, angle=80.0, primitives=2))
    times = np.linspace(0.0, 2.0, 9)
    done: list[float] = []
    far = farthest_apart(a, b, times, done.append)
    wanted = []
    for one, other in ((a, b), (b, a)):
        for points, positions in zip(one.posed(times)[:, one.used], other.posed(times), strict=True):
            wanted.append(farthest(points, positions[other.triangles]))
    assert far.distance == pytest.approx(max(wanted), rel=1e-12)
    side, frame = divmod(int(np.argmax(wanted)), len(times))
    assert (far.side, far.time) == (side, times[frame])
    one, other = ((a, b), (b, a))[side]
    at = one.posed(times[frame : frame + 1])[:, far.vertex]
    assert farthest(at, other.posed(times[frame : frame + 1])[0, other.triangles]) == far.distance
    assert sum(done) == len(times)


def test_a_surface_is_not_apart_from_itself() -> None:
    a, b = (soup(limb_asset(rings=7, sides=6, primitives=number)) for number in (1, 2))
    assert farthest_apart(a, b, np.linspace(0.0, 2.0, 7), lambda _: None).distance < 1e-7
