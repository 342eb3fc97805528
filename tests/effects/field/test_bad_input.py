"""Fields that cannot be baked get one clear line, exit with 1, and nothing is written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Asset, Json, attribute, stored
from kit.bakes import bake_once, place, report_of
from kit.command import Ran, Wrinkle
from kit.garments import tools_file, tube, with_attribute
from kit.limb import sleeved_limb, tool
from kit.player import wrinkle_columns
from wrinklecli.numeric.arrays import Floats

FOLDS: Json = {"name": "folds"}


def refused(wrinkle: Wrinkle, folder: Path, asset: Asset, *fields: Json, **top: object) -> str:
    """The only line of a bake that is refused."""
    path = place(asset)
    out = folder / "out.glb"
    ran: Ran = wrinkle("bake", path, tools_file(path, *(fields or [FOLDS]), **top), "-o", out)
    assert ran.code == 1, ran.lines
    assert len(ran.lines) == 1, ran.lines
    assert "Traceback" not in ran.lines[0]
    assert not list(folder.iterdir())
    return ran.lines[0]


def one_triangle() -> Asset:
    asset = tube()
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    primitive["indices"] = asset.accessor([0, 1, 17], "u2")
    return asset


def one_bending_triangle() -> Asset:
    asset = one_triangle()
    attribute(asset, 0, "WEIGHTS_0")[[0, 1, 17], :2] = [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    attribute(asset, 0, "JOINTS_0")[[0, 1, 17], :2] = [0, 1]
    return asset


def of_no_size(scale: float = 0.0) -> Asset:
    asset = tube()
    attribute(asset, 0, "POSITION")[:] *= scale
    return asset


def with_nan() -> Asset:
    asset = tube()
    attribute(asset, 0, "POSITION")[7, 1] = np.nan
    return asset


def without_normals() -> Asset:
    asset = tube()
    attribute(asset, 0, "NORMAL")[:] = 0.0
    return asset


def without_triangles() -> Asset:
    asset = tube()
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    faces = stored(asset, primitive["indices"])
    faces[1::3] = faces[::3]
    return asset


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("made", "line"),
    [
        (lambda: tube(normals=False), "fields[0]: limb is faceted: a field needs a smooth surface with normals"),
        (without_normals, "fields[0]: limb is faceted: a field needs a smooth surface with normals"),
        (lambda: tube(skinned=False, clip=None), "no mesh of the asset deforms: it has neither a skin nor morph"),
        (
            lambda: tube(skinned=False, clip=None, morphs=2, morph_clip="LINEAR"),
            "fields[0]: limb has no skin: a field needs joints that fold it",
        ),
        (one_triangle, "fields[0]: no joint of its mesh turns"),
        (one_bending_triangle, "fields[0]: "),
        (of_no_size, "fields[0]: limb has no triangle with an area"),
        (lambda: tube(root={"scale": [0.0, 0.0, 0.0]}), "fields[0]: limb has no triangle with an area"),
        (without_triangles, "fields[0]: limb has no triangle with an area"),
        (with_nan, "POSITION (accessor 0) of vertex 7 is not a finite number"),
    ],
)
def test_a_mesh_that_cannot_wrinkle(wrinkle: Wrinkle, tmp_path: Path, made: Callable[[], Asset], line: str) -> None:
    assert line in refused(wrinkle, tmp_path, made())


@pytest.mark.quick(6)
@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"substance": ["leather"]}, "fields[0].substance: nothing of limb looks like leather: it is 'skin'"),
        ({"wavelength": 0}, "fields[0].wavelength: found 0, expected auto, a length from"),
        ({"wavelength": -0.1}, "fields[0].wavelength: found -0.1, expected auto, a length from"),
        ({"wavelength": "0%"}, "fields[0].wavelength: found '0%', expected auto, a length from"),
        ({"wavelength": "wide"}, "fields[0].wavelength: found 'wide', expected auto, a length from"),
        ({"wavelength": 5.0}, "fields[0].wavelength: a wavelength of 5 is longer than its mesh, 2.12"),
        ({"wavelength": "300%"}, "is longer than its mesh, 2.12"),
        ({"slack": 0.02}, "fields[0].slack: found 0.02, expected a percentage from 0% to 50%"),
        ({"slack": "60%"}, "fields[0].slack: found '60%', expected a percentage from 0% to 50%"),
        ({"joints": []}, "fields[0].joints: found a list of 0, expected all or a list of names of joints"),
        ({"joints": ["joint_l"]}, "no joint 'joint_l' bends its mesh; did you mean 'joint_1'?; there are 'joint_1'"),
        ({"clips": {"fol": 1}}, "fields[0].clips.fol: the asset has no clip 'fol'; did you mean 'fold'?"),
        ({"node": "limp"}, "fields[0].node: node 'limp' is no node with a mesh; did you mean 'limb'?"),
        ({"node": []}, "fields[0].node: found a list of 0, expected a node or a list of nodes"),
        ({"node": [3]}, "fields[0].node[0]: found 3, expected text"),
        ({"mask": {"attribute": "_WRINKLE"}}, "fields[0].mask.attribute: the mesh of limb has no _WRINKLE"),
        ({"substance": ["silk"]}, "fields[0].substance[0]: found 'silk', expected skin, cloth or leather"),
        ({"substance": "skin"}, "fields[0].substance: found 'skin', expected a list of skin, cloth and leather"),
        ({"material": "silk"}, "fields[0].material: found 'silk', expected"),
        ({"strength": 11}, "fields[0].strength: found 11, expected a number from 0 to 10"),
        ({"seed": -1}, "fields[0].seed: found -1"),
        ({"variation": 2}, "fields[0].variation: found 2, expected a number from 0 to 1"),
        ({"waves": 3}, "waves"),
        ({"strength": 0}, "no tool is left: those that there are, are absent or of strength 0"),
    ],
)
def test_keys_that_do_not_fit(wrinkle: Wrinkle, tmp_path: Path, keys: Json, line: str) -> None:
    assert line in refused(wrinkle, tmp_path, tube(), {**FOLDS, **keys})


def test_a_mask_of_nothing(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = tube()
    with_attribute(asset, "_WRINKLE", np.zeros(len(attribute(asset, 0, "POSITION"))))
    line = refused(wrinkle, tmp_path, asset, {**FOLDS, "mask": {"attribute": "_WRINKLE"}})
    assert "fields[0].mask: the mask leaves nothing of folds" in line


def test_names_that_are_taken(wrinkle: Wrinkle, tmp_path: Path) -> None:
    taken = "names differ in letters, digits, _"
    line = refused(wrinkle, tmp_path, tube(), FOLDS, FOLDS)
    assert f"fields[1].name: found 'folds', but fields[0] is 'folds' in morph targets: {taken}" in line
    line = refused(wrinkle, tmp_path, tube(), FOLDS, tools=[tool(name="folds", bumps=2)])
    assert f"fields[0].name: found 'folds', but tools[0] is 'folds' in morph targets: {taken}" in line


def test_several_meshes_and_no_node(wrinkle: Wrinkle, tmp_path: Path) -> None:
    line = refused(wrinkle, tmp_path, sleeved_limb(rings=11, sides=8))
    assert "fields[0]: several meshes deform; say which, by node: one of 'limb', 'sleeve'" in line


def test_a_surface_that_hardly_bends_is_refused_with_its_slack(wrinkle: Wrinkle, tmp_path: Path) -> None:
    """It bends by what is below the slack."""
    stiff = tube(root={"scale": [1.0, 1.0, 1.0]})
    line = refused(wrinkle, tmp_path, stiff, {**FOLDS, "joints": ["joint_1"], "slack": "50%", "wavelength": 1.0})
    assert "hardly anything of limb loses more than 50 % of its length, the slack, as its joints turn" in line


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-20, 1e-12])
def test_a_mesh_of_almost_no_size_is_baked_or_refused(wrinkle: Wrinkle, tmp_path: Path, scale: float) -> None:
    path = place(of_no_size(scale))
    ran = wrinkle("bake", path, tools_file(path, FOLDS), "-o", tmp_path / "out.glb", "--max-levels", "0")
    assert ran.code in (0, 1), ran.lines
    assert ran.code == 0 or len(ran.lines) == 1


def noisy(seed: int) -> Asset:
    """Skin weights drawn for each vertex."""
    asset = tube()
    weights, places = attribute(asset, 0, "WEIGHTS_0"), attribute(asset, 0, "POSITION")
    _, at = np.unique(places.round(5), axis=0, return_inverse=True)
    share: Floats = np.random.default_rng(seed).random(at.max() + 1)[at.reshape(-1)]
    weights[:] = np.stack([1.0 - share, share, 0.0 * share, 0.0 * share], axis=1)
    attribute(asset, 0, "JOINTS_0")[:] = [0, 1, 0, 0]
    return asset


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "levels"), [(1, 0), pytest.param(2, 2, marks=pytest.mark.slow)])
def test_noisy_weights_make_no_spikes(seed: int, levels: int) -> None:
    """No fold is higher than the tallest that a wave can be: half a wavelength from valley to crest, varied."""
    file = bake_once(place(noisy(seed)), top={"fields": [{**FOLDS, "variation": 0}]}, max_levels=levels)
    (entry,) = report_of(file).data["fields"]
    moves = np.linalg.norm(file.deltas("limb")[wrinkle_columns(file, "limb")], axis=2)
    assert np.isfinite(moves).all()
    assert moves.max() < 0.5 * entry["wavelength"]


@pytest.mark.slow
@pytest.mark.parametrize("levels", [0, pytest.param(4, marks=[pytest.mark.slow, pytest.mark.long])])
def test_waves_that_are_shorter_than_edges_are_told(levels: int) -> None:
    """No refinement could show them: the line names the key that allows more."""
    file = bake_once(place(tube()), top={"fields": [{**FOLDS, "wavelength": 0.002}]}, max_levels=levels)
    said = report_of(file).data["warnings"]
    assert any("edges are still too long for the wrinkles at max_levels" in each for each in said)
    moves = np.linalg.norm(file.deltas("limb")[wrinkle_columns(file, "limb")], axis=2)
    assert moves.max() < 0.002


@pytest.mark.slow
def test_a_joint_that_is_not_there_is_left_out_where_a_field_is_optional() -> None:
    file = bake_once(
        place(tube()), top={"fields": [{**FOLDS, "joints": ["joint_1", "tail"], "optional": True}]}, max_levels=0
    )
    assert wrinkle_columns(file, "limb")


@pytest.mark.slow
def test_an_optional_field_without_any_of_its_joints_is_left_out(wrinkle: Wrinkle, tmp_path: Path) -> None:
    tail = {**FOLDS, "name": "tail", "joints": ["tail", "tail_2"], "optional": True}
    file = bake_once(place(tube()), top={"fields": [FOLDS, tail]}, max_levels=0)
    report = report_of(file).data
    assert "tail: left out, as there is no node 'tail', 'tail_2'" in report["warnings"]
    assert [each["name"] for each in report["fields"]] == ["folds"]
    line = refused(wrinkle, tmp_path, tube(), tail)
    assert "no tool is left: those that there are, are absent or of strength 0" in line
    line = refused(wrinkle, tmp_path, tube(), {**tail, "optional": False})
    assert "no joint 'tail' bends its mesh" in line
    assert "no joint 'joint_0' bends its mesh" in refused(wrinkle, tmp_path, tube(), {**tail, "joints": ["joint_0"]})


@pytest.mark.slow
def test_a_field_under_another_is_told() -> None:
    """The bake tells of a field that an equal one leaves low; one that folds other places keeps its height."""
    asset = tube()
    along = attribute(asset, 0, "POSITION")[:, 0]
    with_attribute(asset, "_ONE", (along < 0).astype(float))
    with_attribute(asset, "_OTHER", (along > 0).astype(float))
    first, second = ({"name": name, "mask": {"attribute": name}} for name in ("_ONE", "_OTHER"))
    told = [
        report_of(bake_once(place(asset), top={"fields": fields}, max_levels=0)).data["warnings"]
        for fields in ([FOLDS, {"name": "again"}], [first, second])
    ]
    assert any("again: tools and fields before it leave" in each for each in told[0])
    assert not any("leave" in each for each in told[1])
