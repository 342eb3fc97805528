"""Triangles that wrinkles turn over are counted where they show as teeth, and nowhere else."""

from typing import Any

import numpy as np

from kit.carried import carry_patch, moved, scattered
from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.character.pose import blend, joint_matrices, transform
from wrinklecli.effects.faults import count_turned_over, deepest_moment, turned_over
from wrinklecli.effects.sampling import seen_at
from wrinklecli.effects.wrinkle.layer import WrinklePart
from wrinklecli.numeric.arrays import face_normals, unit, vertex_normals


def turned(max_height: Any, time: float, **asset: Any) -> int:
    made = prepare(limb_asset(**asset), tool(max_height=max_height, bumps=3, width=0.4))
    carried, fine = carry_patch(made)
    return count_turned_over(WrinklePart(carried, 0), fine, made.rig, made.clip, time)


def test_only_wrinkles_that_are_steep_in_a_fold_turn_triangles_over() -> None:
    assert turned("none", 0.5, angle=150.0) > 0
    assert turned("2%", 1.0, angle=60.0) == 0
    assert turned("none", 0.0, angle=150.0) == 0
    # Skinning alone turns the inside of this fold over, and hardly any wrinkles are on it.
    assert turned(1e-5, 1.0, angle=170.0) == 0


def test_the_count_is_that_of_the_whole_mesh() -> None:
    made = prepare(limb_asset(angle=150.0), tool(max_height="none", bumps=3, width=0.4))
    carried, fine = carry_patch(made)
    matrices = joint_matrices(made.rig, made.clip, np.array([0.5]))
    blended = blend(fine.dense_weights(np.arange(len(fine.positions)), len(made.rig.joints)), matrices)
    found = []
    for displacement in (0.0, scattered(carried, fine, moved(made, carried, fine, [0.5]))[0]):
        places = transform(blended, fine.positions + displacement)[0]
        normals = vertex_normals(places, fine.triangles)[fine.triangles]
        cosines = np.einsum("tx,tcx->tc", unit(face_normals(places, fine.triangles)), normals)
        found.append(cosines.min(axis=1) < 0)
    # The normals that the joints carry, in place of those of the surface: it is inside out where they differ by more.
    places = transform(blended, fine.positions)[0]
    carried_ones = unit(np.einsum("vji,vj->vi", np.linalg.inv(blended[0, :, :, :3]), fine.normals))
    faces = face_normals(places, fine.triangles)
    hidden = (np.einsum("tx,tcx->tc", faces, carried_ones[fine.triangles]) < 0).any(axis=1)
    wanted = found[1] & ~found[0] & ~hidden
    assert count_turned_over(WrinklePart(carried, 0), fine, made.rig, made.clip, 0.5) == wanted.sum() > 0


def test_a_triangle_is_turned_over_by_one_corner() -> None:
    up, leaning, down = [0.0, 0.0, 1.0], [1.0, 0.0, 0.1], [1.0, 0.0, -0.1]
    triangles, normals = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 2]]), np.array([up, leaning, down])
    assert turned_over(triangles, np.tile([0.0, 0.0, 5.0], (3, 1)).T, normals.T).tolist() == [False, False, True]


def test_the_deepest_moment_is_that_of_the_greatest_shortening() -> None:
    made = prepare(limb_asset(), tool())
    part, times = WrinklePart(carry_patch(made)[0], 0), np.linspace(0.0, 2.0, 21)
    seen, still = (seen_at(part, made.rig, made.clip, each) for each in (times, times[:1]))
    assert deepest_moment(part, [still, seen]) == (made.clip, 1.0)
    assert deepest_moment(part, [still]) is None
    assert deepest_moment(part, []) is None
