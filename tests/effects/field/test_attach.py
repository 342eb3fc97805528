"""Fields on a mesh at rest: where they may be, how long their waves are, and which joints fold them."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, Json, attribute
from kit.garments import attached, bent_tube, cut_open, split_materials, tallest, tube, with_attribute
from kit.limb import LENGTH, RADIUS
from wrinklecli.effects.field import attach
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.intersections import edges_of

RED, BLUE = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
WAVE = 0.12


def near(field: AttachedField, where: Bools | Ints) -> float:
    """The tallest height at some places, over the tallest of all."""
    return float(tallest(field)[where].max() / tallest(field).max())


@pytest.mark.quick(1)
@pytest.mark.parametrize(("stops", "fades"), [("features", True), ("none", False)])
def test_heights_fade_at_a_hem(stops: str, fades: bool) -> None:
    """The tube is slit open along its compressed side."""
    ground, field = attached(cut_open(tube(sides=24), 0.05), stops=stops, wavelength=WAVE)
    height = ground.rest.positions[:, 1]
    used = np.unique(ground.surface.triangles)
    hem = used[height[used] < np.sort(np.unique(height[used].round(6)))[0] + 1e-6]
    assert len(hem) > 20
    assert (near(field, hem) < 1e-9) == fades


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("colours", "stops", "fades"),
    [((RED, BLUE), "features", True), ((RED, RED), "features", False), ((RED, BLUE), "none", False)],
)
def test_heights_fade_at_a_seam_of_materials(colours: list[list[float]], stops: str, fades: bool) -> None:
    """Not where two primitives only look alike."""
    ground, field = attached(split_materials(tube(primitives=2), *colours), stops=stops, wavelength=WAVE)
    seam = np.abs(ground.rest.positions[:, 0]) < 1e-6
    assert seam.sum() == 16
    assert (near(field, seam) < 1e-9) == fades
    # Beside it they rise as elsewhere.
    assert near(field, np.abs(ground.rest.positions[:, 0]) < 0.25) > 0.9


def flat_shaded(asset: Asset, *, uneven: bool = True) -> Asset:
    """A tube whose triangles have normals of their own; no two lie in one plane where it is uneven."""
    positions = attribute(asset, 0, "POSITION")
    if uneven:
        _, at = np.unique(positions.round(5), axis=0, return_inverse=True)
        rng = np.random.default_rng(0)
        positions[:, 1:] *= rng.uniform(0.85, 1.0, at.max() + 1)[at.reshape(-1), None]
    corners = positions.reshape(-1, 3, 3).astype(float)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    attribute(asset, 0, "NORMAL")[:] = np.repeat(flat, 3, axis=0)
    return asset


@pytest.mark.parametrize("shading", ["none", pytest.param("flat"), pytest.param("bands")])
def test_a_faceted_mesh_is_refused(shading: str) -> None:
    bare = tube(sides=8, indices="u2" if shading == "none" else None, normals=shading != "none")
    asset = bare if shading == "none" else flat_shaded(bare, uneven=shading == "flat")
    with pytest.raises(WrinkleError) as caught:
        attached(asset)
    assert str(caught.value).endswith("fields[0]: limb is faceted: a field needs a smooth surface with normals")
    assert len(str(caught.value).splitlines()) == 1


def test_flat_places_beside_smooth_ones_get_none() -> None:
    """One half of the tube is drawn flat."""
    asset = flat_shaded(tube(sides=16, indices=None))
    positions, normals = attribute(asset, 0, "POSITION"), attribute(asset, 0, "NORMAL")
    whole = (positions[:, 2] > -1e-6).reshape(-1, 3).all(axis=1).repeat(3)
    normals[whole] = (positions * [0.0, 1.0, 1.0] / np.hypot(positions[:, 1:2], positions[:, 2:]))[whole]
    ground, field = attached(asset)
    side = ground.rest.positions[:, 2]
    heights = tallest(field) / tallest(field).max()
    assert np.quantile(heights[side < -0.1], 0.9) < 0.05
    assert near(field, side > 0.05) == 1.0


def test_folds_run_over_a_crease_within_cloth() -> None:
    """A limb of six sides is drawn smooth, except at an edge along its compressed side, such as a pressed crease."""
    asset = flat_shaded(tube(sides=6, indices=None), uneven=False)
    positions, normals = attribute(asset, 0, "POSITION"), attribute(asset, 0, "NORMAL")
    smooth = positions[:, 1] < positions[:, 1].max() - 1e-6
    normals[smooth] = (positions * [0.0, 1.0, 1.0] / np.hypot(positions[:, 1:2], positions[:, 2:]))[smooth]
    ground, field = attached(asset, wavelength="20%")
    crease = ground.rest.positions[:, 1] > ground.rest.positions[:, 1].max() - 1e-6
    assert near(field, crease) > 0.5


@pytest.mark.slow
def test_a_field_lies_on_its_substances() -> None:
    """One half of the tube has the colour of a face."""

    def folded(**keys: Any) -> Floats:
        asset = split_materials(tube(primitives=2), [0.75, 0.41, 0.26], BLUE)
        ground, field = attached(asset, stops="none", wavelength=WAVE, **keys)
        places.append(ground.rest.positions[:, 0])
        return tallest(field)

    places: list[Floats] = []
    everywhere, cloth, both = folded(), folded(substance=["cloth"]), folded(substance=["skin", "cloth"])
    assert both == pytest.approx(everywhere, abs=1e-6 * everywhere.max())
    along = places[0]
    assert not cloth[along < -WAVE].any()
    assert cloth[along < 1e-6].max() < 0.05 * everywhere.max()
    assert cloth[along > 0.2].max() == pytest.approx(everywhere[along > 0.2].max(), rel=0.1)


def test_a_mask_leaves_a_half() -> None:
    asset = tube()
    places = attribute(asset, 0, "POSITION")
    ground, field = attached(
        with_attribute(asset, "_WRINKLE", (places[:, 2] > 0).astype(float)), mask={"attribute": "_WRINKLE"}
    )
    side = ground.rest.positions[:, 2]
    assert not tallest(field)[side < -1e-6].any()
    assert near(field, side > 0.05) == 1.0


def test_what_is_far_from_a_field_is_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Heights are those of a field that all of the mesh is measured for, to more digits than one sees."""
    asset = tube(rings=81)
    places = attribute(asset, 0, "POSITION") * [1.0, 0.4, 0.4]
    asset = with_attribute(asset, "POSITION", places)
    some = with_attribute(asset, "_WRINKLE", (places[:, 0] > 0).astype(float))
    measured, heights, measure = list[int](), list[Floats](), attach.measure

    def counted(sheet: Any, *args: Any, **keys: Any) -> Any:
        measured.append(len(sheet.triangles))
        return measure(sheet, *args, **keys)

    monkeypatch.setattr(attach, "measure", counted)
    for least in (attach.UNSEEN, -1.0):
        monkeypatch.setattr(attach, "UNSEEN", least)
        heights.append(tallest(attached(some, mask={"attribute": "_WRINKLE"}, wavelength=WAVE / 2)[1]))
    assert measured[0] < 0.8 * measured[1]
    assert heights[0] == pytest.approx(heights[1], abs=1e-3 * heights[1].max())


@pytest.mark.slow
def test_a_mask_is_a_factor() -> None:
    asset = tube()
    places = attribute(asset, 0, "POSITION")
    halves = with_attribute(asset, "_WRINKLE", np.full(len(places), 0.5))
    _, field = attached(halves, mask={"attribute": "_WRINKLE"})
    # A factor acts where a height begins and where it ends, along crests.
    assert 0.25 <= tallest(field).max() / tallest(bent_tube()[1]).max() <= 0.51


@pytest.mark.slow
def test_wavelengths_are_scene_units_or_per_cent_of_the_girth() -> None:
    girth = 2.0 * np.pi * RADIUS
    _, units = bent_tube(wavelength=0.1 * girth)
    _, shares = bent_tube(wavelength="10%")
    _, usual = bent_tube()
    assert units.wavelength == pytest.approx(0.1 * girth)
    assert np.ptp(units.region.wavelengths) == 0.0
    assert shares.wavelength == pytest.approx(0.1 * girth, rel=0.05)
    assert usual.wavelength == pytest.approx(shares.wavelength)
    assert (units.span, usual.span) == pytest.approx((girth, girth), rel=0.05)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_girth_is_that_of_the_surface_wherever_bones_are(share: float) -> None:
    """The first joint lies where the second one is, so its bone has no length, or far beside the limb."""
    asset = tube()
    first, second = asset.gltf["nodes"][1:3]
    assert first["children"] == [2]
    beside = np.array([LENGTH / 2.0, 4.0 * share * RADIUS, 0.0])
    first["translation"] = (np.array(first["translation"]) + beside).tolist()
    second["translation"] = (np.array(second["translation"]) - beside).tolist()
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[0, 3, :3] = [0.0, -beside[1], 0.0]
    asset.gltf["skins"][0]["inverseBindMatrices"] = asset.accessor(binds.reshape(2, 16))
    _, field = attached(asset)
    assert field.girth == pytest.approx(2.0 * np.pi * RADIUS, rel=0.03)


def test_a_part_of_what_goes_round_a_limb_has_the_girth_of_the_whole() -> None:
    _, part = attached(cut_open(tube(sides=32), 0.1))
    assert part.girth == pytest.approx(2.0 * np.pi * RADIUS, rel=0.03)


def test_waves_are_longer_on_thicker_limbs() -> None:
    """They go with the root of the girth; a length in scene units is the same everywhere."""
    asset = tube(rings=41)
    places = attribute(asset, 0, "POSITION")
    places[:, 1:] *= 1.0 + 0.5 * places[:, :1]
    number = asset.gltf["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    asset.gltf["accessors"][number] |= {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    ground, field = attached(asset, wavelength="10%")
    x = ground.rest.positions[:, 0]
    thin, thick = (field.region.wavelengths[np.abs(x - at) < 0.05].mean() for at in (-0.6, 0.6))
    assert thick / thin == pytest.approx(np.sqrt(1.3 / 0.7), rel=0.1)


@pytest.mark.slow
def test_materials_have_waves_and_slack_of_their_own() -> None:
    found = {material: bent_tube(material=material)[1] for material in ("skin", "cloth", "leather")}
    waves = {material: each.wavelength for material, each in found.items()}
    assert waves["skin"] < waves["cloth"] < waves["leather"]


def two_bends() -> Asset:
    return tube(joints=3, rings=31)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("joints", "folding"), [("all", {2, 3}), (["joint_1"], {2}), (["joint_2", "joint_1"], {2, 3})])
def test_the_joints_that_a_field_names_fold_it(joints: str | list[str], folding: set[int]) -> None:
    ground, field = attached(two_bends(), joints=joints)
    assert {signal.node for signal, _ in field.drive.turns} == folding
    x = ground.rest.positions[:, 0]
    assert near(field, np.abs(x + 1.0 / 3.0) < 0.1) > 0.5
    assert (near(field, np.abs(x - 1.0 / 3.0) < 0.1) > 0.5) == (3 in folding)


def test_joints_whose_matrices_are_stored_whole_turn_as_others_do() -> None:
    """Joints may be stored as matrices, as assimp writes them; a clip cannot move these."""
    asset = tube(clip=None)
    for joint in asset.gltf["skins"][0]["joints"]:
        node = asset.gltf["nodes"][joint]
        matrix = np.eye(4)
        matrix[3, :3] = node.pop("translation")
        node["matrix"] = matrix.ravel().tolist()
    _, found = attached(asset)
    _, wanted = attached(tube(clip=None))
    assert found.factors.shapes == pytest.approx(wanted.factors.shapes, abs=1e-9)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (
            {"joints": ["joint_l"]},
            "fields[0].joints: no joint 'joint_l' bends its mesh; did you mean 'joint_1'?; there are",
        ),
        ({"joints": ["limb"]}, "fields[0].joints: no joint 'limb' bends its mesh"),
        ({"wavelength": 3.0}, "fields[0].wavelength: a wavelength of 3 is longer than its mesh, 2.1"),
        ({"wavelength": "400%"}, "fields[0].wavelength: a wavelength of 6.2"),
    ],
)
def test_what_does_not_fit_is_told(keys: Json, line: str) -> None:
    with pytest.raises(WrinkleError) as caught:
        attached(tube(), **keys)
    assert line in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_percentage_of_what_is_flat_asks_for_a_length() -> None:
    flat = tube()
    attribute(flat, 0, "POSITION")[:, 1] = 0.0
    attribute(flat, 0, "NORMAL")[:] = [0.0, 1.0, 0.0]
    for wavelength in ("10%", "auto"):
        with pytest.raises(WrinkleError) as caught:
            attached(flat, wavelength=wavelength)
        assert "fields[0].wavelength: a percentage is of the girth of a limb, and what is flat has" in str(caught.value)
        assert "give a length in scene units" in str(caught.value)


def test_every_problem_is_told_at_once() -> None:
    with pytest.raises(WrinkleError) as caught:
        attached(tube(), joints=["nobody"], wavelength=9.0)
    assert "longer than its mesh" in str(caught.value)


def test_weights_are_tables_of_angles() -> None:
    _, field = bent_tube()
    data = json.loads(json.dumps(field.drive.to_json(["limb", "joint_0", "joint_1"], [])))
    (turn,) = data["turns"]
    assert (turn["joint"], turn["parent"]) == ("joint_1", "joint_0")
    assert np.degrees(turn["angles"][-1]) == pytest.approx(90.0, abs=0.1)
    weights = np.array(turn["weights"])
    assert not weights[np.argmin(np.abs(turn["angles"]))].any()
    assert (weights.min(), weights.max()) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert data["targets"] == [f"wrinkle_folds_{k + 1}" for k in range(weights.shape[1])]


def test_a_shape_acts_plainly_or_not_at_all() -> None:
    """A weight of a ten thousandth would be one more target that an engine plays at a time."""
    _, field = attached(tube(joints=3, rings=31), wavelength=WAVE)
    tables = [table.table for _, table in field.drive.turns]
    assert tables
    for table in tables:
        assert table[table > 0].min() > 1e-3
        assert (table == 0).any(axis=0).all()


def test_edges_of_low_crests_may_be_longer() -> None:
    """They are split by what is left of the height there, and by how wide a crest is."""
    _, found = attached(tube(rings=81, sides=24), variation=0.15, wavelength="9%")
    region, irregular = found.region, found.region.irregular
    rest, plain = region.pose, replace(region, irregular=replace(irregular, variation=0.0))
    edges = edges_of(rest.triangles[region.members])
    mesh = SimpleNamespace(of_vertices=lambda used, values: values[used], triangles=rest.triangles)
    steps, even = (each.steps(mesh)(edges) for each in (region, plain))
    _, *numbers, _ = irregular.crests(rest.positions, rest.normals, region.directions, region.slants, region.leads)
    longer, higher = np.mean(numbers, axis=1)
    wanted = np.log(np.sqrt(higher[edges].max(axis=1)) / longer[edges].mean(axis=1))
    acting = (even > 0) & (region.shares[edges].max(axis=1) < 0.5)
    found_ratios = np.log(steps[acting] / even[acting])
    # Each family of crests has its own widths and heights.
    assert np.corrcoef(wanted[acting], found_ratios)[0, 1] > 0.7
