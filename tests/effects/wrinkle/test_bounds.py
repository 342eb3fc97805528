"""Wrinkles end at features of the surface: hems and holes, seams of materials, creases, and the other leg."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Array, Asset, Json, stored
from kit.command import Wrinkle
from kit.limb import write_tools
from wrinklecli import check
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.numeric.arrays import vertex_normals
from wrinklecli.surface.refine import Refinement

CELL = 0.1  # scene units between the rows and columns of a cloth
BUMP = 0.2  # scene units: four on a line of 0.8
FADE = BUMP / 2

Surface = Callable[[Array, Array], Array]


def flat(x: Array, z: Array) -> Array:
    """A level cloth."""
    return np.stack([x, 0.0 * x, z], axis=-1)


def patchwork(*pieces: tuple[tuple[float, float], int], shape: Surface = flat, hole: Any = None) -> Asset:
    """Pieces of cloth side by side, drawn over (x, z): each with its ends along x, and its material.

    Normals of each piece are its own. `hole` says of (x, z) of the middles of cells which are left out.
    """
    asset = Asset()
    primitives: list[Json] = []
    for (low, high), material in pieces:
        xs, zs = np.linspace(low, high, round((high - low) / CELL) + 1), np.linspace(-0.6, 0.6, 13)
        x, z = (each.ravel() for each in np.meshgrid(np.round(xs, 9), np.round(zs, 9), indexing="ij"))
        positions = shape(x, z)
        rows, columns = (each.ravel() for each in np.meshgrid(range(len(xs) - 1), range(len(zs) - 1), indexing="ij"))
        a = rows * len(zs) + columns
        b, c, d = a + 1, a + len(zs), a + len(zs) + 1
        if hole is not None:
            kept = ~hole((x[a] + x[d]) / 2, (z[a] + z[d]) / 2)
            a, b, c, d = (each[kept] for each in (a, b, c, d))
        faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
        primitives.append(
            {
                "attributes": {
                    "POSITION": asset.accessor(positions, bounds=True),
                    "NORMAL": asset.accessor(vertex_normals(positions, faces)),
                },
                "indices": asset.accessor(faces.ravel(), "u2"),
                "targets": [{"POSITION": asset.accessor(0.0 * positions, bounds=True)}],
                "material": material,
            }
        )
    asset.append("meshes", {"primitives": primitives})
    asset.append("nodes", {"mesh": 0, "name": "cloth"})
    asset.gltf["materials"] = [
        {"name": "denim", "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.5, 1.0]}},
        {"name": "leather", "pbrMetallicRoughness": {"baseColorFactor": [0.4, 0.2, 0.1, 1.0]}},
        {"name": "denim again", "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.5, 1.0]}},
    ]
    return asset


def attached(folder: Path, asset: Asset, **keys: Any) -> tuple[CarriedPatch, Refinement]:
    """A tool of four bumps along x on the refined cloth."""
    asked = {"name": "t", "width": 0.8, "bumps": 4, "variation": 0, "attenuation": "linear", **keys}
    asked = {"origin": [-0.4, 0.0, 0.0], "target": [0.4, 0.0, 0.0], **asked}
    path = asset.write(folder / "cloth.glb")
    file = write_tools(folder / "tools.yaml", asked, refinement={"max_levels": 3})
    (plan,) = plan_meshes(read_job(path, file, BakeOptions()))
    return carried_patches_of(plan)[0], plan.fine


def left(folder: Path, asset: Asset, **keys: Any) -> tuple[Array, Array]:
    """(vertices, 3) rest positions of vertices on the patch, and the part of their height that features leave."""
    stopped, fine = attached(folder, asset, **keys)
    rows = np.round(fine.rest_positions[stopped.vertices], 6)
    known = dict(zip(map(tuple, rows), stopped.magnitudes, strict=True))
    whole, free = attached(folder, asset, stops="none", **keys)
    places = free.rest_positions[whole.vertices]
    kept = np.array([known.get(tuple(row), 0.0) for row in np.round(places, 6)])
    return places, kept / whole.magnitudes


def faded(distances: Array) -> Array:
    """The part of the height that is left at some distances from a feature."""
    t = np.clip(distances / FADE, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def test_a_hem_keeps_its_line_and_wrinkles_rise_over_half_a_bump(tmp_path: Path) -> None:
    places, kept = left(tmp_path, patchwork(((-1.0, 0.3), 0)), origin=[-0.5, 0.0, 0.0], target=[0.3, 0.0, 0.0])
    assert kept == pytest.approx(faded(0.3 - places[:, 0]), abs=1e-6)
    assert (kept < 0.2).any()
    assert (kept == 1.0).mean() > 0.7


def test_wrinkles_end_round_a_hole(tmp_path: Path) -> None:
    """A cell is missing in the middle of the patch, as an eye's is."""
    hole = (0.0, 0.1, 0.0, 0.2)
    places, kept = left(
        tmp_path,
        patchwork(((-1.0, 1.0), 0), hole=lambda x, z: (x > hole[0]) & (x < hole[1]) & (z > hole[2]) & (z < hole[3])),
    )
    dx = np.maximum(np.maximum(hole[0] - places[:, 0], places[:, 0] - hole[1]), 0.0)
    dz = np.maximum(np.maximum(hole[2] - places[:, 2], places[:, 2] - hole[3]), 0.0)
    assert kept == pytest.approx(faded(np.hypot(dx, dz)), abs=1e-6)


def test_wrinkles_end_at_another_material_and_rise_again_behind_it(tmp_path: Path) -> None:
    """The tool runs over both pieces for more than a bump."""
    places, kept = left(tmp_path, patchwork(((-1.0, 0.0), 0), ((0.0, 1.0), 1)))
    assert kept == pytest.approx(faded(np.abs(places[:, 0])), abs=1e-6)


def test_an_anchor_may_lie_on_the_waistband(tmp_path: Path) -> None:
    """Less than a bump of the line runs over the band: the band stays, and all other wrinkles do."""
    places, kept = left(tmp_path, patchwork(((-1.0, 0.3), 0), ((0.3, 1.0), 1)))
    assert kept == pytest.approx(np.where(places[:, 0] > 0.3, 0.0, faded(0.3 - places[:, 0])), abs=1e-6)


@pytest.mark.parametrize("band", [0.1, 0.2])
def test_a_tool_on_a_narrow_band_does_not_vanish(tmp_path: Path, band: float) -> None:
    pieces = [((-1.0, -band), 0), ((-band, band), 1), ((band, 1.0), 0)]
    along = {"origin": [0.0, 0.0, -0.4], "target": [0.0, 0.0, 0.4]}
    places, kept = left(tmp_path, patchwork(*pieces), **along)
    on_band = np.abs(places[:, 0]) < band
    assert kept[~on_band].max(initial=0.0) == 0.0
    assert kept[on_band].max() > 0.99


@pytest.mark.parametrize("second", [0, 2], ids=["the same material", "an equal one of another name"])
def test_a_mere_split_of_primitives_is_no_feature(tmp_path: Path, second: int) -> None:
    carried, _ = attached(tmp_path, patchwork(((-1.0, 0.0), 0), ((0.0, 1.0), second)))
    assert carried.patch.reach is None


def test_textures_of_one_image_look_the_same(tmp_path: Path) -> None:
    asset = patchwork(((-1.0, 0.0), 0), ((0.0, 1.0), 1))
    asset.gltf["images"] = [{"uri": "a.png"}, {"uri": "b.png"}]
    asset.gltf["textures"] = [{"source": 0, "name": "one"}, {"source": 0}, {"source": 1}]

    def textured(*numbers: int) -> bool:
        asset.gltf["materials"][:2] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in numbers]
        return attached(tmp_path, asset)[0].patch.reach is None

    assert textured(0, 1)
    assert not textured(0, 2)


def bent(degrees: float) -> Surface:
    """A cloth that is bent along z at x = 0.2."""

    def shape(x: Array, z: Array) -> Array:
        past = np.maximum(x - 0.2, 0.0)
        turn = np.radians(degrees)
        return np.stack([np.minimum(x, 0.2) + np.cos(turn) * past, -np.sin(turn) * past, z], axis=-1)

    return shape


@pytest.mark.quick(1)
@pytest.mark.parametrize(("degrees", "stops"), [(90.0, True), (60.0, True), (30.0, False)])
def test_a_hard_crease_is_a_feature_if_it_is_sharp(tmp_path: Path, degrees: float, stops: bool) -> None:
    asset = patchwork(((-1.0, 0.2), 0), ((0.2, 1.0), 0), shape=bent(degrees))
    keys = {"target": [0.2, 0.0, 0.0]}
    places, kept = left(tmp_path, asset, **keys)
    expected = np.abs(places[:, 0] - 0.2) / 0.075 if stops else np.ones(len(places))  # bumps are 0.15 wide
    t = np.clip(expected, 0.0, 1.0)
    before = places[:, 0] <= 0.2
    assert kept[before] == pytest.approx((t * t * (3 - 2 * t))[before], abs=1e-6)


@pytest.mark.parametrize(("degrees", "stops"), [(90.0, True), (72.0, False)])
def test_a_smooth_crease_is_a_feature_if_it_is_sharper_than_a_coarse_limb(
    tmp_path: Path, degrees: float, stops: bool
) -> None:
    carried, _ = attached(tmp_path, patchwork(((-1.0, 1.0), 0), shape=bent(degrees)), target=[0.2, 0.0, 0.0])
    assert (carried.patch.reach is not None) == stops


def test_a_short_crease_is_no_feature(tmp_path: Path) -> None:
    """A spike of one vertex: its edges are sharp, but shorter than a bump."""

    def spike(x: Array, z: Array) -> Array:
        return np.stack([x, np.where((x == 0.0) & (z == 0.2), 0.15, 0.0), z], axis=-1)

    carried, _ = attached(tmp_path, patchwork(((-1.0, 1.0), 0), shape=spike), bumps=1)
    assert carried.patch.reach is None


def test_the_other_leg_stays_smooth(tmp_path: Path) -> None:
    """A deep groove lies between two legs: its far side is near, but the way there is long."""

    def legs(x: Array, z: Array) -> Array:
        return np.stack([x, 0.0 * x, z], axis=-1) - [0.0, 1.0, 0.0] * np.exp(-(((x - 0.3) / 0.1) ** 2))[:, None]

    along = {"origin": [-0.1, 0.0, -0.4], "target": [-0.1, 0.0, 0.4], "width": 1.6}
    places, kept = left(tmp_path, patchwork(((-1.0, 1.0), 0), shape=legs), **along)
    assert (kept[places[:, 0] < 0.1] == 1.0).all()
    beyond = places[:, 0] > 0.5
    assert beyond.any()
    assert (kept[beyond] == 0.0).all()


def test_stops_none_has_no_bounds(tmp_path: Path) -> None:
    carried, _ = attached(tmp_path, patchwork(((-1.0, 0.0), 0), ((0.0, 0.3), 1)), stops="none")
    assert carried.patch.reach is None


def test_a_hem_of_another_part_does_not_count(tmp_path: Path) -> None:
    """A cuff hangs closely above the patch: near in space, and not connected."""
    body = patchwork(((-1.0, 1.0), 0))
    cuff = patchwork(((-0.2, 0.1), 0), shape=lambda x, z: np.stack([x, 0.0 * x + 0.02, z], axis=-1))
    (other,) = cuff.gltf["meshes"][0]["primitives"]
    names = ("POSITION", "NORMAL")
    body.gltf["meshes"][0]["primitives"].append(
        {
            "attributes": {name: body.accessor(stored(cuff, other["attributes"][name]), bounds=True) for name in names},
            "indices": body.accessor(stored(cuff, other["indices"]), "u2"),
            "targets": [{"POSITION": body.accessor(stored(cuff, other["targets"][0]["POSITION"]), bounds=True)}],
            "material": 1,
        }
    )
    below = {"origin": [-0.4, -0.001, 0.0], "target": [0.4, -0.001, 0.0]}
    carried, _ = attached(tmp_path, body, **below)
    assert carried.patch.reach is None


def with_more_faces(asset: Asset, faces: Callable[[Array], Array]) -> Asset:
    """The cloth with more triangles, a function of its (triangles, 3) corners."""
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    corners = stored(asset, primitive["indices"]).reshape(-1, 3)
    primitive["indices"] = asset.accessor(np.concatenate([corners, faces(corners)]).ravel(), "u2")
    return asset


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "faces",
    [
        lambda corners: corners,
        lambda corners: corners[:, [0, 0, 1]],
        lambda _: np.array([[0, 12, 240], [90, 103, 250]]),
    ],
    ids=["doubled", "degenerate", "with fins"],
)
def test_more_faces_are_no_features(tmp_path: Path, faces: Callable[[Array], Array]) -> None:
    """Faces twice, or without area, or a third at an edge."""
    carried, _ = attached(tmp_path, with_more_faces(patchwork(((-1.0, 1.0), 0)), faces))
    plain, _ = attached(tmp_path, patchwork(((-1.0, 1.0), 0)))
    assert carried.patch.reach is None
    assert len(carried.patch.members) >= len(plain.patch.members)


def test_a_hem_of_doubled_faces_is_a_feature(tmp_path: Path) -> None:
    asset = with_more_faces(patchwork(((-1.0, 0.3), 0)), lambda corners: corners)
    carried, _ = attached(tmp_path, asset, origin=[-0.5, 0.0, 0.0], target=[0.3, 0.0, 0.0])
    assert carried.patch.reach is not None


def test_a_face_that_is_wound_the_other_way_is_no_feature(tmp_path: Path) -> None:
    asset = patchwork(((-1.0, 1.0), 0))
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    corners = stored(asset, primitive["indices"]).reshape(-1, 3).copy()
    corners[1::7] = corners[1::7, ::-1]
    primitive["indices"] = asset.accessor(corners.ravel(), "u2")
    carried, _ = attached(tmp_path, asset)
    assert carried.patch.reach is None


def test_a_path_has_bounds_too(tmp_path: Path) -> None:
    along = [[-0.4, 0.0, -0.1], [-0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0]]
    asset = patchwork(((-1.0, 0.3), 0))
    asked = {"name": "t", "width": 0.8, "bumps": 4, "path": along}
    path = asset.write(tmp_path / "cloth.glb")
    file = write_tools(tmp_path / "tools.yaml", asked, refinement={"max_levels": 3})
    (plan,) = plan_meshes(read_job(path, file, BakeOptions()))
    (carried,) = carried_patches_of(plan)
    assert carried.patch.reach is not None
    places = plan.fine.rest_positions[carried.vertices]
    assert np.abs(carried.magnitudes[places[:, 0] > 0.3 - 1e-6]).max(initial=0.0) < 1e-3


def test_check_says_how_much_features_leave(tmp_path: Path, wrinkle: Wrinkle) -> None:
    path = patchwork(((-1.0, 0.0), 0), ((0.0, 1.0), 1)).write(tmp_path / "cloth.glb")
    keys = {"origin": [-0.4, 0.0, 0.0], "target": [0.4, 0.0, 0.0], "width": 0.8}
    file = write_tools(tmp_path / "tools.yaml", {"name": "t", **keys}, {"name": "u", **keys, "stops": "none"})
    stopped, whole = check(path, file).data["tools"]
    assert 0.5 < stopped["left_by_features"] < 0.95
    assert "left_by_features" not in whole
    lines = [line for line in wrinkle("check", "-v", path, file).out.splitlines() if "stops" in line]
    assert lines == [f"  stops    at features, which leave {100 * stopped['left_by_features']:.0f} % of the wrinkles"]


def test_a_tool_of_which_nothing_would_be_left_wrinkles_features_too(tmp_path: Path) -> None:
    """It lies across a ridge that is narrower than the mesh can show, between two seams."""
    pieces = [((-1.0, -0.1), 0), ((-0.1, 0.0), 1), ((0.0, 1.0), 0)]
    path = patchwork(*pieces).write(tmp_path / "cloth.glb")
    asked = {"name": "t", "origin": [-0.05, 0.0, -0.4], "target": [-0.05, 0.0, 0.4], "width": 0.4}
    file = write_tools(
        tmp_path / "tools.yaml", asked, {**asked, "name": "u", "stops": "none"}, refinement={"max_levels": 0}
    )
    plain, over = check(path, file).data["tools"]
    assert "left_by_features" not in plain
    assert 0 < plain["moved_vertices"] <= over["moved_vertices"]
