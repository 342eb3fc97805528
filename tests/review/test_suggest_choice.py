"""Suggestions leave out or join what an artist would: hard parts, covered skin, lips, both sides of a body."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, attribute, plate, stored
from kit.limb import RADIUS, limb_asset
from kit.prepared import unattached
from kit.suggested import ends, middle
from wrinklecli.choices import Part
from wrinklecli.review.check import check
from wrinklecli.review.suggest.choice import is_limb, rims_of
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.surface.sites import spread_sites
from wrinklecli.surface.strain import read_gauge
from wrinklecli.surface.substance import named

Json = dict[str, Any]


def dressed(asset: Asset, **material: Any) -> Asset:
    """The asset with one material for all primitives of its first mesh."""
    number = asset.append("materials", material)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = number
    return asset


def suggested(folder: Path, asset: Asset, **options: Any) -> Suggestions:
    """Suggestions for an asset, in a file without warnings of `check`."""
    path = asset.write(folder / "asset.glb")
    found = suggest(path, **options)
    if found.text:
        (folder / "tools.yaml").write_text(found.text)
        assert not check(path, folder / "tools.yaml").warnings
    return found


# What it is made of


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("N00_007_03_Tops_01_CLOTH (Instance)", "cloth"),
        ("Body_00_SKIN", "skin"),
        ("EyeIris_00_EYE", "hard"),
        ("leatherJacket", "leather"),
        ("Trousers", "cloth"),
        ("ArmorPlate", "hard"),
        ("Skinned_Mesh.001", None),
        ("Material.001", None),
        ("armature", None),
        ("Wolf3D_Outfit_Bottom", "cloth"),
        ("Std_Eye_Occlusion_L", "hard"),
        ("Fingernails", "hard"),
        ("yoga-pants", "cloth"),
        ("Boy_Bag_mat", "hard"),
        ("靴下", "cloth"),
        ("左目", "hard"),
        ("体_肌", "skin"),
    ],
)
def test_words_of_names_say_what_a_mesh_is_made_of(name: str, kind: str | None) -> None:
    found = named([name], "it")
    assert (found and found.kind) == kind


@pytest.mark.slow
@pytest.mark.parametrize(
    ("material", "kind"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.6, 1.0]}}, "cloth"),
        ({"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.5, 0.4, 1.0]}}, "skin"),
        ({"name": "Lambert1"}, "skin"),
    ],
)
def test_the_file_says_what_wrinkles(tmp_path: Path, material: Json, kind: str) -> None:
    found = suggested(tmp_path, dressed(limb_asset(rings=11, sides=8), **material), count=1)
    assert found.tools[0].tool.material == kind
    assert any(note.startswith(f"'limb': {kind}, ") for note in found.notes)


@pytest.mark.slow
@pytest.mark.long
def test_the_coat_of_an_animal_is_no_cloth(tmp_path: Path) -> None:
    blue = {"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.6, 1.0]}}
    for name in (None, "Saddle cloth"):
        asset = dressed(limb_asset(rings=11, sides=8, joints=3), **blue, **({"name": name} if name else {}))
        asset.gltf["nodes"][asset.gltf["skins"][0]["joints"][2]]["name"] = "tail"
        found = suggested(tmp_path, asset, count=1)
        assert (bool(found.fields), bool(found.tools)) == (name is not None, name is None)
        assert all(each.substance and each.substance.kind == "skin" for each in found.tools)


def rigid() -> Asset:
    """A limb whose halves follow one joint each."""
    asset = limb_asset(rings=12, sides=8)
    weights = attribute(asset, 0, "WEIGHTS_0")
    weights[:] = np.eye(4)[weights.argmax(axis=1)]
    return asset


@pytest.mark.slow
@pytest.mark.parametrize(
    ("asset", "why"),
    [
        (rigid(), "follows one joint"),
        (dressed(limb_asset(rings=11, sides=8), pbrMetallicRoughness={"metallicFactor": 1.0}), "metallic"),
        (dressed(limb_asset(rings=11, sides=8), name="Steel"), "named Steel"),
    ],
)
def test_hard_parts_are_left_out_unless_all_are_asked_for(tmp_path: Path, asset: Asset, why: str) -> None:
    path = asset.write(tmp_path / "limb.glb")
    found = suggest(path)
    assert not found.tools
    assert any(why in note and "--all" in note for note in found.notes)
    every = suggest(path, everything=True)
    assert {each.tool.material for each in every.tools} == {None}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "name", "count"), [(100.0, "Leather", 1), (-100.0, "Leather", 0), (-100.0, "Skin", 0)]
)
def test_toes_fold_on_top(tmp_path: Path, angle: float, name: str, count: int) -> None:
    asset = dressed(limb_asset(rings=11, sides=8, angle=angle), name=name)
    for node, part in ((1, "foot_l"), (2, "toes_l")):
        asset.gltf["nodes"][node]["name"] = part
    found = suggested(tmp_path, asset, count=1)
    assert len(found.tools) == count
    assert any("on top of the toes" in note for note in found.notes) == (not count)


@pytest.mark.slow
@pytest.mark.parametrize("hand", [False, True])
def test_a_grey_arm_gets_a_tool_unless_its_hand_shows_other_skin(tmp_path: Path, hand: bool) -> None:
    asset = limb_asset(rings=21, sides=8, colors=True)
    for node, part in ((1, "upperarm_l"), (2, "hand_l")):
        asset.gltf["nodes"][node]["name"] = part
    colours = attribute(asset, 0, "COLOR_0")
    colours[:] = 200
    if hand:
        # Colours are linear.
        colours[attribute(asset, 0, "POSITION")[:, 0] > 0.5] = [205, 130, 95]
    found = suggest(asset.write(tmp_path / "asset.glb"))
    assert any("nothing says what it is made of" in note for note in found.notes)
    assert bool(found.tools) == (not hand)


# What nobody sees


def sleeved(factor: float) -> Asset:
    """A limb, and a mesh of the same joints around it that is thicker by a factor."""
    asset = limb_asset(rings=16, sides=12)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    places = stored(asset, primitive["attributes"]["POSITION"]).copy()
    places[:, 1:] *= factor
    attributes = {**primitive["attributes"], "POSITION": asset.accessor(places, bounds=True)}
    asset.append("meshes", {"name": "sleeve", "primitives": [{**primitive, "attributes": attributes}]})
    node = asset.append("nodes", {"name": "sleeve", "mesh": len(asset.gltf["meshes"]) - 1, "skin": 0})
    asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


@pytest.mark.slow
@pytest.mark.long
def test_what_is_under_another_mesh_where_it_folds_is_left_out(tmp_path: Path) -> None:
    found = suggested(tmp_path, sleeved(1.1))
    assert not found.tools
    assert [each.field.node for each in found.fields] == ["sleeve"]
    assert {(each.mesh, each.reason) for each in found.dropped} <= {("limb", "hidden"), ("limb", "hardly seen")}
    assert {each.tool.node for each in suggest(tmp_path / "asset.glb", everything=True).tools} == {"limb"}


# Sides


@pytest.mark.slow
@pytest.mark.long
def test_the_twin_of_a_fold_is_suggested_though_no_clip_folds_it(tmp_path: Path) -> None:
    asset = limb_asset(joints=3, angle=200.0)
    channels = asset.gltf["animations"][0]["channels"]
    channels[:] = channels[:1]
    (best,) = suggested(tmp_path, asset, count=1).tools
    assert best.mirrored
    assert middle(best.tool)[0] < 0, "the side that the clip folds is written"


def forehead(*targets: str) -> Asset:
    """A curved sheet, and morph targets that raise two places at its lower border, one to either side.

    One target raises both; of two, the first one raises that towards +x, and the other that towards -x.
    """
    asset = Asset()
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-0.07, 0.07, 29), np.linspace(0.0, 0.1, 21)))
    places = np.stack([x, y, -8.0 * x * x], axis=1)
    normals = np.stack([16.0 * x, 0.0 * x, 1.0 + 0.0 * x], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near = np.exp(-(((np.abs(x) - 0.03) / 0.025) ** 2))
    raised = np.stack([0.0 * x, 0.012 * near * np.clip((0.07 - y) / 0.04, 0.0, 1.0), 0.0 * x], axis=1)
    deltas = [raised] if len(targets) == 1 else [np.where(side[:, None], raised, 0.0) for side in (x > 0, x < 0)]
    corner = (np.arange(20)[:, None] * 29 + np.arange(28)).ravel()
    faces = np.stack([corner, corner + 1, corner + 29, corner + 1, corner + 30, corner + 29], axis=1)
    primitive = {
        "attributes": {"POSITION": asset.accessor(places, bounds=True), "NORMAL": asset.accessor(normals)},
        "indices": asset.accessor(faces.ravel(), "u2"),
        "targets": [{"POSITION": asset.accessor(each, bounds=True)} for each in deltas],
    }
    asset.append("meshes", {"primitives": [primitive], "extras": {"targetNames": list(targets)}})
    asset.append("nodes", {"name": "face", "mesh": 0})
    asset.append("scenes", {"nodes": [0]})
    return asset


@pytest.mark.slow
def test_two_brows_that_rise_make_one_tool_across_the_forehead(tmp_path: Path) -> None:
    (tool,) = (each.tool for each in suggested(tmp_path, forehead("browsUp")).tools)
    assert np.abs(np.array(ends(tool))[:, 0]).max() < 1e-3
    assert tool.width.value > 0.08
    # The skin itself shortens enough.
    assert tool.rest_length == "auto"


def test_a_limb_that_is_hard_is_left_out_and_the_reason_says_so(tmp_path: Path) -> None:
    found = suggested(tmp_path, dressed(limb_asset(rings=12, sides=8), name="ArmorPlate"))
    assert not found.tools
    assert "left out, as the notes say" in found.reason
    assert any("ArmorPlate" in note for note in found.notes)


@pytest.mark.slow
def test_a_fold_of_a_finger_ends_within_its_bones(tmp_path: Path) -> None:
    asset = limb_asset(rings=31, sides=8, joints=6, angle=300.0)
    spans = []
    for name in ("Finger", "Tentacle"):
        for node in asset.gltf["nodes"][1:7]:
            node["name"] = f"{name} {node['name'][-1]}"
        found = suggested(tmp_path, asset, count=2, everything=True)
        spans.append(max(each.span for each in found.tools))
    assert spans[0] < 0.5 * spans[1]


def hand(*names: str) -> Asset:
    """A flat tube along x, whose half beyond the fold has a joint for each of equal parts across z; all fold alike."""
    asset = limb_asset(rings=31, sides=48, seam=False)
    positions, joints = attribute(asset, 0, "POSITION"), attribute(asset, 0, "JOINTS_0")
    number = np.clip((positions[:, 2] / RADIUS + 1.0) / 2.0 * len(names), 0, len(names) - 1).astype(int)
    joints[joints == 1] = (1 + np.broadcast_to(number[:, None], joints.shape))[joints == 1]
    positions[:, 2] *= 2.5
    nodes, (skin,), (clip,) = asset.gltf["nodes"], asset.gltf["skins"], asset.gltf["animations"]
    inverse = stored(asset, skin["inverseBindMatrices"])
    skin["inverseBindMatrices"] = asset.accessor(np.concatenate([inverse, *[inverse[1:]] * (len(names) - 1)]))
    more = [asset.append("nodes", {"translation": nodes[2]["translation"]}) for _ in names[1:]]
    nodes[1]["children"] += more
    skin["joints"] += more
    clip["channels"] += [{**clip["channels"][0], "target": {"node": node, "path": "rotation"}} for node in more]
    for node, name in zip([2, *more], names, strict=True):
        nodes[node]["name"] = name
    return asset


@pytest.mark.slow
@pytest.mark.long
def test_fingers_that_fold_along_one_line_get_a_tool_each(tmp_path: Path) -> None:
    fingers, tentacles = (
        suggested(tmp_path, hand(*(f"{name} {k}" for k in "abc")), everything=True).tools
        for name in ("Finger", "Tentacle")
    )
    assert [each.driver for each in tentacles] == ["Tentacle b"]
    assert {each.driver for each in fingers} == {"Finger a", "Finger b", "Finger c"}
    third = 2.0 * 2.5 * RADIUS / 3.0
    for each in fingers:
        assert each.tool.width.value < 1.3 * third < tentacles[0].tool.width.value
        assert abs(middle(each.tool)[2] - third * ("abc".index(each.driver[-1]) - 1)) < third / 3.0


def bent(joint: str) -> Asset:
    """A limb in the colour of cloth, of which nothing else says that, that bends at a joint of this name."""
    asset = dressed(limb_asset(), pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.6, 1.0]})
    asset.gltf["nodes"][asset.gltf["skins"][0]["joints"][1]]["name"] = joint
    return asset


@pytest.mark.slow
def test_folds_of_a_shirt_are_as_wide_as_the_trunk_and_end_unevenly(tmp_path: Path) -> None:
    (found,) = suggested(tmp_path, bent("Spine1"), count=1, everything=True).tools
    assert found.tool.material == "shirt"
    assert found.tool.broken > 0
    # They fade where the trunk turns away, and not before.
    assert found.tool.width.value > 2.0 * 1.5 * RADIUS


@pytest.mark.slow
def test_a_collar_is_left_out(tmp_path: Path) -> None:
    found = suggested(tmp_path, bent("Neck"))
    assert not found.tools
    assert any("no limb" in note for note in found.notes)


@pytest.mark.slow
def test_the_inner_side_of_a_tube_that_tapers_is_left_out(tmp_path: Path) -> None:
    """Nearly half of a wide tube's inner side is seen from its open ends."""
    asset = limb_asset()
    (outer,) = asset.gltf["meshes"][0]["primitives"]
    keys = outer["attributes"]
    positions, normals = (attribute(asset, 0, name).astype(float) for name in ("POSITION", "NORMAL"))
    taper = 0.95 * np.sqrt(1.04 - positions[:, 0] ** 2)
    inner = {
        **keys,
        "POSITION": asset.accessor(positions * np.column_stack([np.ones(len(taper)), taper, taper]), bounds=True),
        "NORMAL": asset.accessor(-normals),
    }
    triangles = stored(asset, outer["indices"]).reshape(-1, 3)[:, ::-1]
    asset.gltf["meshes"][0]["primitives"] = [{"attributes": inner, "indices": asset.accessor(triangles.ravel(), "u2")}]
    found = suggested(tmp_path, asset)
    assert not found.tools
    assert any("left out 1 tool not worth it" in note for note in found.notes)


@pytest.mark.parametrize(
    ("part", "parts", "limb"),
    [
        ("lower leg", ("hips", "lower leg", None), True),
        ("neck", ("hips", "neck"), False),
        ("neck", ("neck",), False),
        (None, ("hips", "lower leg", None), False),
        (None, (None, "hips", "neck"), True),
        ("finger", ("head", "lower arm", "hand", "finger"), False),
        ("finger", ("lower arm", "hand", "finger"), True),
    ],
)
def test_a_joint_of_no_part_and_a_finger_fold_where_no_limb_is_known(
    part: Part | None, parts: tuple[Part | None, ...], limb: bool
) -> None:
    """On a body with named limbs such a joint is that of hair, a strap or a tail, and nobody sees a finger."""
    assert is_limb(part, parts) is limb


@pytest.mark.slow
def test_layers_of_one_mesh_are_told_apart(tmp_path: Path) -> None:
    asset = sleeved(1.04)
    body, sleeve = asset.gltf["meshes"]
    asset.gltf["meshes"] = [{"primitives": [*body["primitives"], *sleeve["primitives"]]}]
    asset.gltf["scenes"][0]["nodes"].pop()
    asset.gltf["nodes"].pop()
    found = suggest(asset.write(tmp_path / "limb.glb"), count=1)
    radii = [np.linalg.norm(np.array(end)[1:]) for end in ends(found.tools[0].tool)]
    assert min(radii) > 1.02 * RADIUS * np.cos(np.pi / 12), "on the outer one"


def test_rims_are_where_a_surface_ends() -> None:
    flat = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1, 1)
    faces = np.concatenate([first + np.array(each) for each in ((0, 1, 10), (0, 10, 9))])
    made = unattached(plate(flat, faces))
    sites = spread_sites(read_gauge(made.surface, made.rest, made.rig))
    mesh: Any = SimpleNamespace(sites=sites, gauge=sites.gauge, rest=made.rest)
    border = flat[((flat == 0.0) | (flat == 1.0))[:, :2].any(axis=1)]
    assert np.array_equal(np.unique(rims_of(mesh), axis=0), np.unique(border, axis=0))


@pytest.mark.parametrize(("turn", "gap", "looks"), [(1, 0.1, True), (-1, 0.1, False), (1, 0.5, False)])
def test_rims_are_where_a_surface_looks_at_itself_nearby(turn: int, gap: float, looks: bool) -> None:
    """Two sites, as far from the one mesh's border as can be, face each other, turn their backs, or are far away."""
    normals = turn * np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, gap]])
    closed = np.array([[0, 1, 2], [0, 2, 1]])
    mesh: Any = SimpleNamespace(
        sites=SimpleNamespace(positions=places, normals=normals, radius=0.1),
        gauge=SimpleNamespace(triangles=closed),
        rest=SimpleNamespace(positions=np.eye(3)),
    )
    assert rims_of(mesh).tolist() == (places.tolist() if looks else [])
