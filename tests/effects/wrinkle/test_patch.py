"""Tools attached at rest: coordinates along the segment, members of the near side only, all problems at once."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.asset import plate
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import face_normals, vertex_normals
from wrinklecli.tools.records import Length

Floats = NDArray[np.float64]


def test_patch_normal_is_the_anchors_mean_made_square_to_the_segment() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(target=[0.4, 0.0, RADIUS], width=0.1))
    patch = prepared.patch
    mean = patch.origin.normal + patch.target.normal
    assert abs(mean @ patch.along) < 1e-3, "by symmetry"
    bent = prepare(limb_asset(rings=9, sides=8), tool(target=[1.0, 0.0, RADIUS], origin=[0.9, RADIUS, 0], width=0.1))
    cone = prepare(
        plate(
            np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1], [2, 1, 0], [2, 1, 1]], float),
            [[0, 2, 1], [1, 2, 3], [1, 3, 4], [4, 3, 5]],
        ),
        tool(origin=[0.1, 0, 0.5], target=[1.9, 0.9, 0.5], width=0.2),
    )
    for each in (bent.patch, cone.patch):
        mean = each.origin.normal + each.target.normal
        plane = np.cross(np.cross(each.along, mean), each.along)
        assert each.normal == pytest.approx(plane / np.linalg.norm(plane), abs=1e-12)
        assert each.normal @ each.along == pytest.approx(0, abs=1e-12)
    one = cone.patch.origin.normal + cone.patch.target.normal
    assert abs(one @ cone.patch.along) > 0.05, "the case is one"


def test_problems_of_all_tools_are_reported_at_once() -> None:
    tools = [
        tool(name="far", origin=[9, 9, 9]),
        tool(name="good"),
        tool(name="marker", target={"marker": "join_1"}),
        tool(name="morph", rest_length={"morph": "smile", "full": "120%"}),
        tool(name="point", origin=[0, 0.3, 0], target=[0, 0.3, 1e-12], width=0.1),
    ]
    with pytest.raises(BakeError) as caught:
        prepare(limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR"), *tools)
    lines = caught.value.lines
    assert len(lines) == 4
    assert "tools[0].origin: is" in lines[0]
    assert "tools[2].target.marker: no node is named 'join_1'; did you mean 'joint_1'?" in lines[1]
    assert "tools[3].rest_length.morph: the mesh has no morph target 'smile'; there are 'morph_0'" in lines[2]
    assert "tools[4]" in lines[3]


def test_segment_without_length_is_refused() -> None:
    asset = limb_asset(rings=9, sides=8)
    # Only markers can coincide: positions that do are the tools file's fault.
    asset.gltf["nodes"] += [{"name": name, "translation": [0.25, RADIUS, 0]} for name in ("a", "b")]
    with pytest.raises(BakeError, match=r"tools\[0\]: origin and target are one point of the mesh"):
        prepare(asset, tool(origin={"marker": "a"}, target={"marker": "b"}))


def test_ends_that_face_opposite_ways_are_refused() -> None:
    with pytest.raises(BakeError, match="faces opposite ways"):
        prepare(limb_asset(rings=9, sides=8), tool(origin=[0, RADIUS, 0], target=[0, -RADIUS, 0]))


def test_members_face_the_patch_and_are_never_on_the_back_of_a_thin_limb() -> None:
    # Wider than the limb is thick: u and v of the back lie within the patch too.
    prepared = prepare(limb_asset(rings=17, sides=16), tool(width=1.0))
    members = prepared.surface.triangles[prepared.patch.members]
    assert len(prepared.patch.members) > 16
    normals = face_normals(prepared.rest.positions, members)
    assert (normals @ prepared.patch.normal > 0).all()
    assert (prepared.rest.positions[members].mean(axis=1)[:, 1] > 0).all()


@pytest.mark.quick(2)
@pytest.mark.parametrize("width", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("root", [None, {"scale": [1, -1, 1]}, {"scale": [2, 2, 2]}])
def test_members_are_the_connected_facing_triangles_that_the_patch_meets(width: float, root: Any) -> None:
    factor = np.array((root or {}).get("scale", [1, 1, 1]), float)
    ends = {key: (np.array(tool()[key]) * factor).tolist() for key in ("origin", "target")}
    prepared = prepare(limb_asset(rings=17, sides=12, root=root), tool(**ends, width=width))
    surface, patch = prepared.surface, prepared.patch
    u, v = patch.coordinates(prepared.rest.positions)
    # On a tube the facing triangles hang together: here flooding reaches all that meet the box.
    outward = vertex_normals(surface.positions, surface.triangles) * np.sign(factor)
    for face, corners in enumerate(surface.triangles):
        normal = np.cross(*(prepared.rest.positions[corners[1:]] - prepared.rest.positions[corners[0]]))
        normal *= np.sign(normal @ outward[corners].sum(axis=0))
        meets = u[corners].max() >= 0 and u[corners].min() <= 1 and v[corners].max() >= -1 and v[corners].min() <= 1
        assert (face in patch.members) == (meets and normal @ patch.normal > 0)


def test_what_is_not_connected_to_an_anchor_is_no_member() -> None:
    # Two sheets over one another, both facing up; and a third beside the first, within the patch's width.
    square = np.array([[0, 0, 0], [4, 0, 0], [4, 1, 0], [0, 1, 0]], float)
    above, beside = np.array([0, 0, 0.2]), np.array([0, 1.5, 0])
    places = np.concatenate([square, square + above, square + beside])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(3)])
    prepared = prepare(plate(places, faces), tool(origin=[0.5, 0.5, 0], target=[3.5, 0.5, 0], width=9))
    assert prepared.patch.members.tolist() == [0, 1]


def test_patch_within_one_triangle_has_it_as_its_only_member() -> None:
    places = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, -10, 0]], float)
    prepared = prepare(plate(places, [[0, 1, 2], [0, 3, 1]]), tool(origin=[2, 2, 0], target=[3, 2, 0], width=0.5))
    assert prepared.patch.members.tolist() == [0]
    assert prepared.patch.normal.tolist() == [0, 0, 1]


def test_coordinates_of_the_segment_and_the_edges() -> None:
    patch = prepare(limb_asset(rings=9, sides=16), tool(width="50%")).patch
    across = np.cross(patch.along, patch.normal)
    assert patch.half_width == pytest.approx(0.2, abs=1e-7)
    middle = (patch.origin.position + patch.target.position) / 2
    places = np.array(
        [patch.origin.position, patch.target.position, middle + 0.2 * across, middle - 0.1 * across + 3 * patch.normal]
    )
    u, v = patch.coordinates(places)
    assert u == pytest.approx([0, 1, 0.5, 0.5], abs=1e-6)
    assert v == pytest.approx([0, 0, 1, -0.5], abs=1e-6)


@pytest.mark.parametrize("strength", [1.0, -0.5])
def test_attenuation_profiles(strength: float) -> None:
    prepared = prepare(limb_asset(rings=9, sides=16), tool(strength=strength))
    bell = prepared.patch
    linear = replace(bell, tool=replace(bell.tool, attenuation="linear"))
    v = np.linspace(-1.2, 1.2, 49)
    normals = np.tile(bell.normal, (49, 1))
    half = np.full(49, 0.5)
    inside = np.abs(v) <= 1
    wanted_linear = np.where(inside, 1 - np.abs(v), 0)
    # The soft object of Wyvill, McPheeters and Wyvill: 1 - 4/9 v^6 + 17/9 v^4 - 22/9 v^2.
    wanted_bell = np.where(inside, 1 - 4 / 9 * v**6 + 17 / 9 * v**4 - 22 / 9 * v**2, 0)
    assert linear.magnitudes(half, v, normals) == pytest.approx(strength * wanted_linear, abs=1e-15)
    assert bell.magnitudes(half, v, normals) == pytest.approx(strength * wanted_bell, abs=1e-15)


def test_bell_is_1_in_the_middle_half_at_a_half_0_at_the_end_and_flat_there() -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    step = 1e-6

    def bell(v: Any) -> Floats:
        v = np.atleast_1d(v)
        return patch.magnitudes(np.full(len(v), 0.5), v, np.tile(patch.normal, (len(v), 1)))

    assert bell([0.0, 0.5, -0.5, 1.0, -1.0]) == pytest.approx([1, 0.5, 0.5, 0, 0], abs=1e-15)
    # Second order: a step of 1e-6 changes a flat end by its square; curvatures are at most 9 here.
    assert bell([step, 1 - step, -1 + step]) == pytest.approx([1, 0, 0], abs=9 * step**2)
    assert (np.diff(bell(np.linspace(0, 1, 101))) < 0).all()


def test_displacement_fades_as_the_surface_turns_away() -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    across = np.cross(patch.along, patch.normal)
    cosines = np.array([1.0, 0.6, 0.4, 0.2, 0.0, -1.0])
    normals = cosines[:, None] * patch.normal + np.sqrt(1 - cosines**2)[:, None] * across
    middle = np.full(6, 0.5), np.zeros(6)
    assert patch.magnitudes(*middle, normals) == pytest.approx([1, 1, 0.5, 0, 0, 0], abs=1e-14)


@pytest.mark.parametrize(("u", "v"), [(-1e-9, 0), (1 + 1e-9, 0), (0.5, 1 + 1e-9), (0.5, -1 - 1e-9)])
def test_outside_the_patch_the_magnitude_is_exactly_0(u: float, v: float) -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    assert patch.magnitudes(np.array([u]), np.array([float(v)]), patch.normal[None])[0] == 0.0


@pytest.mark.parametrize(
    ("strength", "clips", "shape", "in_fold"),
    [(1.0, {}, 1.0, 1.0), (2.0, {"fold": 1.0}, 2.0, 0.5), (0.0, {"fold": -0.5, "a": 0.1}, -0.5, 1.0), (0, {}, 0, 0)],
)
def test_strength_in_shape_times_that_in_clip_is_what_was_asked(
    strength: float, clips: Any, shape: float, in_fold: float
) -> None:
    prepared = prepare(limb_asset(rings=9, sides=16), tool(strength=strength, clips=clips))
    assert prepared.patch.shape_strength == shape
    assert prepared.patch.clip_strength(prepared.clip) == in_fold
    assert prepared.patch.clip_strength(None) * shape == strength


@pytest.mark.parametrize(
    ("wanted", "nominal", "greatest"),
    [
        ("auto", 0.8, 0.8),
        (0.9, 0.9, 0.9),
        ("110%", 0.88, 0.88),
        ("50%", 0.4, 0.4),
        ({"keys": {"fold": [[0, 0.8], [1, "150%"]]}}, 0.8, 1.2),
        ({"keys": {"fold": [[0, 0.1], [1, "50%"]]}}, 0.8, 0.8),
        ({"morph": "morph_0", "full": "125%"}, 0.8, 1.0),
        ({"morph": "morph_0", "full": 0.2}, 0.8, 0.8),
    ],
)
def test_rest_lengths(wanted: Any, nominal: float, greatest: float) -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    patch = prepare(asset, tool(rest_length=wanted)).patch
    assert patch.span == pytest.approx(0.8, abs=1e-7)
    assert patch.rest_length == pytest.approx(nominal, abs=2e-7)
    assert patch.curve.rest_length == patch.rest_length
    assert patch.curve.longest * patch.rest_length == pytest.approx(greatest, abs=2e-7)
    ends_meet, _ = patch.curve.follow(np.zeros(1), np.full(1, greatest))
    assert np.abs(ends_meet[0]) == pytest.approx(patch.curve.greatest_amplitudes, rel=1e-6)


@pytest.mark.parametrize(("material", "part"), [("none", 0.25), ("skin", 0.13), ("cloth", 0.38), ("leather", 0.38)])
def test_auto_height_is_the_material_s(material: str, part: float) -> None:
    patch = prepare(limb_asset(rings=9, sides=8), tool(material=material, bumps=2, gap=1, variation=0)).patch
    assert patch.curve.max_height == pytest.approx(0.8 / 5 * 2 * part, abs=1e-7)


@pytest.mark.parametrize(
    ("wanted", "height"),
    [("auto", 0.8 / 8 * 2 * 0.25), (None, np.inf), ("none", np.inf), (0.03, 0.03), ("10%", 0.08)],
)
def test_max_height(wanted: Any, height: float) -> None:
    patch = prepare(limb_asset(rings=9, sides=8), tool(max_height=wanted, bumps=4, variation=0)).patch
    assert patch.curve.max_height == pytest.approx(height, abs=1e-7)


def test_lengths_in_per_cent_are_of_the_tool_s_own_span() -> None:
    patch = prepare(limb_asset(rings=9, sides=8), tool(width="25%")).patch
    assert patch.half_width == pytest.approx(Length(12.5, percent=True).resolve(patch.span), abs=1e-15)
