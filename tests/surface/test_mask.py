"""Masks: what is painted on vertices or in an image is a factor on heights, and nothing else changes."""

import re
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kit.asset import Array, Asset, attribute, stored
from kit.command import Wrinkle
from kit.limb import limb_asset, tool, write_tools
from wrinklecli import bake, check
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.carry import CarriedPatch, carry
from wrinklecli.effects.wrinkle.creases import creased
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.surface.mask import Mask
from wrinklecli.surface.refine import Refinement

RINGS = 12
STEP = 2.0 / (RINGS - 1)  # between rings
WRINKLE = {"attribute": "_WRINKLE"}


def smooth(**keys: Any) -> dict[str, Any]:
    """A tool over the seam of the limb's texture."""
    return tool(variation=0, bumps=2, **keys)


def painted_limb(values: Callable[[Array], Array], name: str = "_WRINKLE", **options: Any) -> Asset:
    """A limb with an attribute that is a function of (vertices, 3) positions."""
    asset = limb_asset(rings=RINGS, sides=8, **options)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        positions = np.array(stored(asset, primitive["attributes"]["POSITION"]), np.float64)
        primitive["attributes"][name] = asset.accessor(values(positions))
    return asset


def right_half(positions: Array) -> Array:
    """1 where x is above 0, and 0 elsewhere."""
    return np.asarray((positions[:, 0] > 0).astype(float))


def with_uvs(uvs: Callable[[Array], list[Array]], **options: Any) -> Asset:
    """A limb whose texture coordinates are a function of (vertices, 3) positions."""
    asset = limb_asset(**{"rings": RINGS, "sides": 8, **options})
    attribute(asset, 0, "TEXCOORD_0")[:] = np.stack(uvs(attribute(asset, 0, "POSITION")), axis=1)
    return asset


def save(path: Path, rows: Any, mode: str = "L") -> None:
    """Write an image of rows of 0 to 255."""
    pixels = np.asarray(rows, np.uint8)
    Image.frombytes(mode, (pixels.shape[1], pixels.shape[0]), pixels.tobytes()).save(path)


def attached(
    folder: Path, asset: Asset, asked: dict[str, Any], *, levels: int = 2, **options: Any
) -> tuple[CarriedPatch, Refinement]:
    """The tool on the refined surface, as a bake has it."""
    plan = planned(folder, asset, asked, levels=levels, **options)
    return carried_patches_of(plan)[0], plan.fine


def planned(folder: Path, asset: Asset, asked: dict[str, Any], *, levels: int, **options: Any) -> MeshPlan:
    """The plan of a bake."""
    path = asset.write(folder / "limb.glb")
    file = write_tools(folder / "tools.yaml", asked, refinement={"max_levels": levels})
    (plan,) = plan_meshes(read_job(path, file, BakeOptions(**options)))
    return plan


def moved(folder: Path, asset: Asset, asked: dict[str, Any], **options: Any) -> tuple[Array, Array]:
    """(vertices, 3) rest positions of the vertices that move, and (vertices,) factors of the curve's height."""
    carried, fine = attached(folder, asset, asked, **options)
    return fine.rest_positions[carried.vertices], carried.magnitudes


@pytest.mark.parametrize("attachment", ["skin", "patch"])
def test_an_attribute_multiplies_the_height(tmp_path: Path, attachment: str) -> None:
    asset = painted_limb(lambda at: 0.25 + 0.0 * at[:, 0])
    places, whole = moved(tmp_path, asset, smooth(attachment=attachment))
    same, quarter = moved(tmp_path, asset, smooth(attachment=attachment, mask=WRINKLE))
    assert (same == places).all()
    assert quarter == pytest.approx(0.25 * whole, rel=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize("attachment", ["skin", "patch"])
def test_a_bake_plays_the_masked_heights(tmp_path: Path, attachment: str) -> None:
    """The proof of a bake compares the file with the method, whose heights have the mask."""
    path = painted_limb(right_half).write(tmp_path / "limb.glb")
    asked = smooth(attachment=attachment, mask=WRINKLE, max_height="10%")
    report = bake(path, write_tools(tmp_path / "tools.yaml", asked), tmp_path / "out.glb", fps=8)
    (clip,) = report.data["clips"]
    assert clip["residual"]["position"] <= 0.01 * report.data["tallest_wrinkle"]
    assert 0.3 < report.data["tools"][0]["mask"] < 0.7


@pytest.mark.parametrize("component", ["", ".r", ".a"])
def test_a_component_of_a_colour_is_a_mask(tmp_path: Path, component: str) -> None:
    asset = painted_limb(lambda at: right_half(at)[:, None] * [1.0, 0.0, 0.0, 1.0], "COLOR_0")
    places, factors = moved(tmp_path, asset, smooth(mask={"attribute": f"COLOR_0{component}"}))
    assert factors[places[:, 0] > 0.5 * STEP + 1e-9].max() > 0.5
    assert places[:, 0].min() > -0.5 * STEP - 1e-9, "what the mask leaves out does not move"


def test_where_the_mask_is_0_the_mesh_stays_as_it_was(tmp_path: Path) -> None:
    carried, fine = attached(tmp_path, painted_limb(right_half), smooth(mask=WRINKLE))
    split = fine.rest_positions[len(fine.surface.positions) :, 0]
    assert len(split)
    assert split.min() > -1.5 * STEP - 1e-9, "only triangles that close the gap are split there"
    assert 0.3 < carried.patch.mask_share < 0.7


def test_a_coarse_mesh_takes_a_fine_mask(tmp_path: Path) -> None:
    """Four stripes lie between two rings, which only refined vertices can tell apart."""
    save(tmp_path / "stripes.png", [[255, 0] * 10 + [255]])
    asset = with_uvs(lambda at: [0.5 * (at[:, 0] + 1.0), 0.5 + 0.0 * at[:, 0]], rings=7)
    plan = planned(tmp_path, asset, smooth(mask={"image": "stripes.png"}), levels=4)
    (carried,), fine = carried_patches_of(plan), plan.fine
    places, factors = fine.rest_positions[carried.vertices], carried.magnitudes
    mask = np.interp(10.5 * (places[:, 0] + 1.0) - 0.5, np.arange(21), [1.0, 0.0] * 10 + [1.0])
    whole = carry(replace(carried.patch, mask=None), fine, np.zeros(len(fine.rest.positions), bool))
    whole = creased(whole, fine, plan.rest, plan.rig)
    unmasked = whole.magnitudes[np.searchsorted(whole.vertices, carried.vertices)]
    assert mask.max() > 0.9
    assert mask.min() < 0.2
    assert factors == pytest.approx(mask * unmasked, abs=1e-5)


@pytest.mark.parametrize("channel", ["r", "g", "b", "a"])
def test_a_channel_of_an_image_is_a_mask_with_v_downwards(tmp_path: Path, channel: str) -> None:
    pixels = np.zeros((8, 4, 4))
    pixels[:4, :, "rgba".index(channel)] = 255
    save(tmp_path / "mask.png", pixels, "RGBA")
    asset = with_uvs(lambda at: [0.0 * at[:, 0], 0.5 - 0.5 * at[:, 0]])  # v is 0, and the row the first, at x = 1
    places, factors = moved(tmp_path, asset, smooth(mask={"image": "mask.png", "channel": channel}))
    assert factors[places[:, 0] > 0.2].max() > 0.5
    assert places[:, 0].min() > -0.3


def test_texture_coordinates_are_those_of_texcoord_and_are_clamped(tmp_path: Path) -> None:
    asset = painted_limb(lambda at: np.stack([3.0 * np.sign(at[:, 0]), 0.0 * at[:, 0]], axis=1), "TEXCOORD_1")
    save(tmp_path / "mask.png", [[0, 255]])
    places, factors = moved(tmp_path, asset, smooth(mask={"image": "mask.png", "texcoord": 1}))
    assert places[:, 0].min() > -0.3
    assert factors.max() > 0.9, "an image does not repeat beyond its border"


def test_a_grey_image_of_16_bits_is_read_whole(tmp_path: Path) -> None:
    Image.frombytes("I;16", (2, 1), np.array([13107, 13107], "<u2").tobytes()).save(tmp_path / "mask.png")
    _, whole = moved(tmp_path, limb_asset(rings=RINGS, sides=8), smooth())
    _, factors = moved(tmp_path, limb_asset(rings=RINGS, sides=8), smooth(mask={"image": "mask.png"}))
    assert factors == pytest.approx(0.2 * whole, rel=1e-4)


@pytest.mark.parametrize("primitives", [1, 3])
def test_no_seam_opens(tmp_path: Path, primitives: int) -> None:
    """The seam of the texture runs along the tool: its two sides are at opposite ends of the image."""
    save(tmp_path / "mask.png", [[255, 200, 150, 100, 50, 0]])
    path = limb_asset(rings=RINGS, sides=8, primitives=primitives).write(tmp_path / "limb.glb")
    file = write_tools(tmp_path / "tools.yaml", smooth(mask={"image": "mask.png"}))
    bake(path, file, tmp_path / "out.glb")
    document = read_document(tmp_path / "out.glb")
    places, moves = [], []
    for primitive in document.items("meshes")[0]["primitives"]:
        places.append(document.accessor(primitive["attributes"]["POSITION"]))
        moves.append(np.stack([document.accessor(target["POSITION"]) for target in primitive["targets"]], axis=1))
    rows, which = np.unique(np.concatenate(places), axis=0, return_inverse=True)
    every = np.concatenate(moves)
    first = np.zeros((len(rows), *every.shape[1:]))
    first[which.reshape(-1)] = every
    assert len(rows) < len(every)
    assert np.abs(every).max() > 0.01
    assert (first[which.reshape(-1)] == every).all()


def test_check_says_how_much_the_mask_leaves(tmp_path: Path, wrinkle: Wrinkle) -> None:
    path = painted_limb(right_half).write(tmp_path / "limb.glb")
    file = write_tools(tmp_path / "tools.yaml", smooth(mask=WRINKLE), smooth(name="whole"))
    masked, whole = check(path, file).data["tools"]
    assert 0.3 < masked["mask"] < 0.7
    assert "mask" not in whole
    lines = wrinkle("check", "-v", path, file).out.splitlines()
    assert [line for line in lines if "mask" in line] == [
        f"  mask     leaves {100 * masked['mask']:.0f} % of the patch"
    ]


def test_a_mirrored_tool_and_defaults_share_a_mask(tmp_path: Path) -> None:
    path = painted_limb(right_half).write(tmp_path / "limb.glb")
    pair = {"origin": [0.2, 0.25, 0.0], "target": [0.6, 0.25, 0.0], "mirror": "x", "name": "a.L"}
    file = write_tools(tmp_path / "tools.yaml", smooth(**pair), defaults={"mask": WRINKLE})
    with pytest.raises(WrinkleError, match=r"defaults.mask: the mask leaves nothing of a.R"):
        check(path, file)
    free = write_tools(tmp_path / "tools.yaml", smooth(**pair, mask="none"), defaults={"mask": WRINKLE})
    assert ["mask" in each for each in check(path, free).data["tools"]] == [False, False]


ODD = {
    "an attribute that is not there": (
        {"attribute": "_SKIN"},
        r"mask.attribute: the mesh of limb has no _SKIN; it has .*_WRINKLE",
    ),
    "a component that is not there": (
        {"attribute": "_WRINKLE.g"},
        r"mask.attribute: _WRINKLE has 1 components: there is no g",
    ),
    "values above 1": (
        {"attribute": "_LARGE"},
        r"mask.attribute: _LARGE is 0 to 7 under the tool, expected 0 to 1",
    ),
    "a mask of zeros": (
        {"attribute": "_ZERO"},
        r"tools\[0\].mask: the mask leaves nothing of crease",
    ),
    "an image that is not there": (
        {"image": "no.png"},
        r"mask.image: 'no.png' cannot be read: No such file",
    ),
    "an image that is none": (
        {"image": "tools.yaml"},
        r"mask.image: 'tools.yaml' cannot be read: it is no PNG, JPEG or WebP",
    ),
    "a folder": (
        {"image": "."},
        r"mask.image: .*cannot be read: Is a directory",
    ),
    "an opaque image": (
        {"image": "grey.png", "channel": "a"},
        r"mask.image: 'grey.png' has no channel a: it is opaque",
    ),
    "texture coordinates that are not there": (
        {"image": "grey.png", "texcoord": 3},
        r"mask.texcoord: .*has no TEXCOORD_3",
    ),
    "an image elsewhere": (
        {"image": "../grey.png"},
        r"mask.image: '../grey.png' is not a file below the folder of the too",
    ),
    "no image": (
        {"channel": "r"},
        r"mask.image: required, but missing",
    ),
    "another attribute": (
        {"attribute": "POSITION"},
        r"mask.attribute: found 'POSITION', expected COLOR_0 or _NAME",
    ),
    "another channel": (
        {"image": "grey.png", "channel": "red"},
        r"mask.channel: found 'red', expected r, g, b or a",
    ),
    "a word": (
        "face.png",
        r"mask: found 'face.png', expected \{attribute: NAME\}, \{image: FILE",
    ),
    "an unknown key": (
        {"attribute": "_WRINKLE", "chanel": "r"},
        r"mask.chanel: unknown key",
    ),
}


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", ODD)
def test_a_mask_that_does_not_fit_is_refused(tmp_path: Path, name: str, wrinkle: Wrinkle) -> None:
    mask, message = ODD[name]
    asset = painted_limb(right_half)
    attributes = asset.gltf["meshes"][0]["primitives"][0]["attributes"]
    count = len(stored(asset, attributes["_WRINKLE"]))
    attributes["_LARGE"] = asset.accessor(np.arange(count) % 8)
    attributes["_ZERO"] = asset.accessor(np.zeros(count))
    (tmp_path / "in").mkdir()
    path = asset.write(tmp_path / "in" / "limb.glb")
    save(tmp_path / "in" / "grey.png", [[255]])
    save(tmp_path / "grey.png", [[255]])
    file = write_tools(tmp_path / "in" / "tools.yaml", smooth(mask=mask))
    ran = wrinkle("bake", path, file, "-o", tmp_path / "out.glb")
    assert ran.code == 1
    (line,) = ran.lines
    assert re.search(message, line), line
    assert not (tmp_path / "out.glb").exists()


def test_an_image_elsewhere_is_read_if_allowed(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    save(tmp_path / "grey.png", [[255]])
    asked = smooth(mask={"image": "../grey.png"})
    _, factors = moved(tmp_path / "in", limb_asset(rings=RINGS, sides=8), asked, allow_external=True)
    assert factors.max() > 0.9


def test_a_preset_may_have_a_mask(tmp_path: Path) -> None:
    path = painted_limb(right_half).write(tmp_path / "limb.glb")
    save(tmp_path / "mask.png", [[128]])
    given = {"jeans": {"material": "cloth", "mask": {"image": "mask.png"}}}
    file = write_tools(tmp_path / "tools.yaml", tool(material="jeans"), presets=given)
    assert check(path, file).data["tools"][0]["mask"] == pytest.approx(128 / 255, rel=1e-6)


def test_a_welded_vertex_has_the_mean_of_its_copies() -> None:
    painted = Mask(np.array([[0.2], [0.6], [1.0], [0.1]]), None)
    assert painted.welded(np.array([1, 1, 0, 1]), 3) == pytest.approx([1.0, 0.3, 0.0])


def test_the_image_is_a_dependency_and_is_not_overwritten(tmp_path: Path, wrinkle: Wrinkle) -> None:
    path = limb_asset(rings=RINGS, sides=8).write(tmp_path / "limb.glb")
    save(tmp_path / "mask.png", [[255]])
    file = write_tools(tmp_path / "tools.yaml", smooth(mask={"image": "mask.png"}))
    out = tmp_path / "out.glb"
    assert wrinkle("bake", path, file, "-o", out, "--depfile", tmp_path / "out.d").code == 0
    assert str(tmp_path / "mask.png") in (tmp_path / "out.d").read_text()
    before = (tmp_path / "mask.png").read_bytes()
    commands = [["bake", path, file, "-o", out, "--report"], ["preview", path, "--tools", file, "-o"]]
    if find_spec("matplotlib"):
        commands.append(["check", path, file, "--plot"])
    for command in commands:
        ran = wrinkle(*command, tmp_path / "mask.png")
        assert ran.code == 1
        assert "mask.png" in ran.lines[0]
    assert (tmp_path / "mask.png").read_bytes() == before


@pytest.mark.quick(1)
@pytest.mark.parametrize("turn", [0.3, 1.2])
def test_a_border_in_an_image_is_seen_as_it_is_painted(tmp_path: Path, turn: float) -> None:
    """The border runs askew over faces that the wrinkles alone would leave large."""
    across, along = np.meshgrid(np.linspace(-1, 1, 128), np.linspace(-1, 1, 128))
    save(tmp_path / "border.png", 255 * (np.cos(turn) * across + np.sin(turn) * along > 0.05))
    asset = with_uvs(lambda at: [0.5 * (at[:, 0] + 1.0), 0.5 + 0.5 * at[:, 2] / np.abs(at[:, 2]).max()], rings=7)
    asked = smooth(mask={"image": "border.png"}, width=0.8)
    carried, fine = attached(tmp_path, asset, asked, levels=5)
    patch = carried.patch
    assert patch.mask is not None
    faces = np.flatnonzero(np.isin(fine.subdivision.parents, patch.members))
    corners, shares = fine.surface.corners[fine.subdivision.parents[faces]], fine.subdivision.barycentrics[faces]
    places = fine.rest_positions[fine.triangles[faces]]
    u, v = patch.coordinates(places)
    inside = ((u > 0.05) & (u < 0.95) & (np.abs(v) < 0.5)).all(axis=1)
    wide = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    broken = inside & (patch.mask.errors(corners, shares, 3) > 0.4)
    assert broken.sum() > 10
    assert wide[broken].max() <= patch.span / patch.intervals / 2 / 3 * 1.001
    plain, _ = attached(tmp_path, asset, smooth(width=0.8), levels=5)
    assert len(carried.vertices) < 3 * len(plain.vertices)
