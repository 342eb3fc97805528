"""Surfaces of other triangles over time: the greatest distance is that of all times looked at one by one."""

import numpy as np
import pytest

from kit.asset import Asset
from kit.bakes import place
from kit.limb import limb_asset
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.scene import ScenePrimitive, read_scene
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.closest import on_triangles
from wrinklecli.review.diff.common_clips import CommonClip
from wrinklecli.review.diff.surfaces import compare_surfaces

Side = tuple[tuple[ScenePrimitive, ...], Clip]


def read(asset: Asset) -> Side:
    document = read_document(place(asset))
    return read_scene(document), read_clips(document)[0]


def surface(side: Side, time: float) -> tuple[Floats, Floats]:
    """(vertices, 3) and (triangles, 3, 3) of all primitives at a time, one by one."""
    primitives, clip = side
    points, corners = [], []
    for each in primitives:
        positions = each.posed(clip, np.array([time])).positions[0]
        points.append(positions[each.seen])
        corners.append(positions[each.triangles])
    return np.concatenate(points), np.concatenate(corners)


def farthest(points: Floats, corners: Floats) -> float:
    """The greatest distance of (points, 3) from (triangles, 3, 3), by all pairs."""
    pairs = np.repeat(points, len(corners), axis=0), np.tile(corners, (len(points), 1, 1))
    away = np.linalg.norm(on_triangles(*pairs)[1] - pairs[0], axis=1)
    return float(away.reshape(len(points), -1).min(axis=1).max())


@pytest.mark.slow
@pytest.mark.parametrize("rings", [9, 10])
def test_the_farthest_vertex_of_all_times_is_found(rings: int) -> None:
    sides = (
        read(limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")),
        read(limb_asset(rings=rings, sides=7, angle=80.0, primitives=2)),
    )
    times = np.linspace(0.0, 2.0, 9)
    done: list[float] = []
    common = CommonClip((sides[0][1], sides[1][1]), times)
    found = compare_surfaces(sides[0][0], sides[1][0], common, times, done.append).worst
    wanted = [
        [farthest(surface(one, time)[0], surface(other, time)[1]) for time in times]
        for one, other in (sides, sides[::-1])
    ]
    assert found.distance == pytest.approx(np.max(wanted), rel=1e-12)
    side, frame = divmod(int(np.argmax(wanted)), len(times))
    assert (found.side, found.time) == ("AB"[side], times[frame])
    (primitives, clip), other = sides[side], sides[1 - side]
    (primitive,) = (each for each in primitives if each.primitive == int(found.place.rpartition("/")[2]))
    at = primitive.posed(clip, times[frame : frame + 1]).positions[:, found.vertex]
    assert farthest(at, surface(other, times[frame])[1]) == found.distance
    assert sum(done) == len(times)


def test_a_surface_is_not_apart_from_itself() -> None:
    (a, clip_a), (b, clip_b) = (read(limb_asset(rings=7, sides=6, primitives=number)) for number in (1, 2))
    times = np.linspace(0.0, 2.0, 7)
    apart = compare_surfaces(a, b, CommonClip((clip_a, clip_b), times), times, lambda _: None)
    assert apart.worst.distance < 1e-7
