"""`suggest --face` finds the tools of an artist where targets of a face, by any of their names, compress its skin."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.bakes import place
from kit.face import BROWS, CHIN, CORNER, EYE, EYES, HAIR, MOUTH, MUSCLES, NOSE, Face
from kit.golden import Golden
from kit.samples import sample
from kit.suggested import ends, middle, run, suggest_once
from wrinklecli import check
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.face_parts import _eyes_below
from wrinklecli.review.suggest.face_targets import motions_of
from wrinklecli.review.suggest.faces import _beside_mouth
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.review.suggest.worth import Judge, Worthwhile
from wrinklecli.surface.rest import rest_pose
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import RestLengthMorph

EVERY = ["forehead", "forehead_side.L", "glabella", "crows_foot.L", "bunny.L", "nasolabial.L", "chin"]
# Without a target of the nose or the chin, as of a VRM.
EXPRESSIVE = [name for name in EVERY if name not in ("bunny.L", "chin")]
VARIANTS: dict[str, tuple[Face, Callable[[Face], Asset], list[str]]] = {
    "arkit": (Face(whole=True), Face.asset, EVERY),
    "facs": (Face(), Face.facs, EVERY),
    "vroid": (Face(), Face.vroid, EXPRESSIVE),
    "vrm 1": (Face(), Face.vrm, EXPRESSIVE),
    "vrm 0": (Face(), lambda face: face.vrm(0), EXPRESSIVE),
    "big eyes": (Face(big_eyes=1.6), Face.asset, EVERY),
    "centimetres, z up": (Face(z_up=True, scale=100.0, place=(0.0, 150.0, 0.0)), Face.asset, EVERY),
    "turned": (Face(turn=40.0, place=(0.3, 0.1, 0.0)), Face.asset, EVERY),
}
# Others are this face by other names, in other units or axes, or with other eyes: their tools are found anew, and not
# judged again, which takes longest.
JUDGED = "arkit"


@pytest.mark.parametrize(
    ("name", "motions", "side"),
    [
        ("browInnerUp", "browInnerUp", ""),
        ("head.browOuterUpLeft", "browOuterUp", "L"),
        ("browOuterUp_R", "browOuterUp", "R"),
        ("eyeBlink_L", "eyeBlink", "L"),
        ("AU1", "browInnerUp", ""),
        ("AU01_L", "browInnerUp", "L"),
        ("AU12R", "mouthSmile", "R"),
        ("face_au_06_left", "cheekSquint", "L"),
        ("AU10", "", ""),
        ("BrowRaiser_Inner", "browInnerUp", ""),
        ("Inner Brow Raiser", "browInnerUp", ""),
        ("INNER_BROW_RAISER_R", "browInnerUp", "R"),
        ("innerBrowRaiserL", "browInnerUp", "L"),
        ("CTRL_expressions_browRaiseInL", "browInnerUp", "L"),
        ("Brow_Raise_Outer_R", "browOuterUp", "R"),
        ("browsUp", "browInnerUp browOuterUp", ""),
        ("smile", "mouthSmile", ""),
        ("Face.M_F00_000_00_Fcl_BRW_Surprised", "browInnerUp browOuterUp", ""),
        ("Fcl_EYE_Close_L", "eyeBlink", "L"),
        ("Fcl_MTH_Up", "", ""),
        ("wrinkle_smile_1", "mouthSmile", ""),
        ("cheekPuff", "", ""),
        ("Sau1ce", "", ""),
        ("", "", ""),
        ("まばたき", "", ""),
        *((f"{name}_L", motion, "L") for motion, name in MUSCLES.items()),
    ],
)
def test_a_name_says_a_motion_and_its_side(name: str, motions: str, side: str) -> None:
    said, of_side = motions_of(name)
    assert (" ".join(said), of_side if said else "") == (motions, side)


def test_tools_of_a_face_are_as_before(golden: Golden) -> None:
    found = suggested("facs")[2]
    golden.text("\n".join([found.text, *found.notes]), "suggest_face.txt")


@cache
def suggested(variant: str) -> tuple[Face, Path, Suggestions]:
    face, make, _ = VARIANTS[variant]
    path = place(make(face))
    if variant == JUDGED:
        return face, path, suggest_once(path, face=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Judge, "worthwhile", lambda _, tools, least, **__: Worthwhile(tools, least, []))
        return face, path, suggest(path, face=True)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("variant", VARIANTS)
def test_each_region_has_its_tool(variant: str) -> None:
    face, _, found = suggested(variant)
    *_, names = VARIANTS[variant]
    tools = {each.tool.name: each for each in found.tools}
    if variant == "turned":
        # Nothing mirrors a turned head.
        assert not any(each.mirrored for each in found.tools)
        assert set(tools) == {other for name in names for other in (name, name.replace(".L", ".R"))}
    else:
        assert list(tools) == names
        assert [name for name, each in tools.items() if each.mirrored] == [name for name in names if ".L" in name]
    # In metres of a head that stands upright on the plane x = 0, and looks along z.
    places = {name: upright(face, middle(each.tool)) for name, each in tools.items()}
    ways = {name: upright(face, ends(each.tool)[1]) - upright(face, ends(each.tool)[0]) for name, each in tools.items()}
    ways = {name: np.abs(way / np.linalg.norm(way)) for name, way in ways.items()}
    x, y, _ = places["forehead"]
    assert abs(x) < 0.003
    assert BROWS + 0.003 < y < HAIR
    assert ways["forehead"][1] > 0.85
    x, y, _ = places["forehead_side.L"]
    assert 0.025 < x < 0.06
    assert BROWS + 0.003 < y < HAIR
    x, y, _ = places["glabella"]
    assert abs(x) < 0.003
    assert EYES < y < BROWS + 0.01
    assert ways["glabella"][0] > 0.95
    x, y, _ = places["crows_foot.L"]
    assert EYE + 0.015 < x < 0.075
    assert abs(y - EYES) < 0.012
    assert ways["crows_foot.L"][1] > 0.85
    x, y, _ = places["nasolabial.L"]
    assert CORNER < x < 0.05
    assert MOUTH - 0.01 < y < NOSE
    assert ways["nasolabial.L"][0] > 0.5
    # It runs from beside the nose's wing to beside the mouth, and not below it.
    half = 0.5 * tools["nasolabial.L"].tool.width.value / face.scale
    reach = half * ways["nasolabial.L"][0] / np.hypot(*ways["nasolabial.L"][:2])
    assert NOSE - 0.002 < y + reach < EYES - 0.02
    assert abs(y - reach - MOUTH) < 0.006
    if "bunny.L" in places:
        x, y, _ = places["bunny.L"]
        assert 0.005 < x < 0.02
        assert NOSE < y < EYES
        x, y, _ = places["chin"]
        assert abs(x) < 0.003
        assert CHIN - 0.002 < y < MOUTH - 0.006
    for each in found.tools:
        # Beside the mouth lies one deep furrow, and elsewhere there are a few lines.
        single = each.tool.name.startswith("nasolabial")
        assert (each.tool.bumps, each.tool.strength) == (1, -1.0) if single else 3 <= each.tool.bumps <= 5
        assert each.shortening > 0.04
        assert each.by_morph


def upright(face: Face, place: np.ndarray) -> np.ndarray:
    """A place of an asset, as the face is built before it is turned, scaled and moved."""
    turn = np.radians(face.turn)
    c, s = np.cos(turn), np.sin(turn)
    pivot = np.array([0.0, 0.0, -0.01])
    return np.asarray(
        ((place - face.place) / face.scale - pivot) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + pivot
    )


def test_the_face_has_all_targets_of_arkit() -> None:
    """Source: Apple, ARKit, ARFaceAnchor.BlendShapeLocation."""
    both = """browDown browOuterUp cheekSquint eyeBlink eyeLookDown eyeLookIn eyeLookOut eyeLookUp eyeSquint eyeWide
        mouthDimple mouthFrown mouthLowerDown mouthPress mouthSmile mouthStretch mouthUpperUp noseSneer"""
    middle = """browInnerUp cheekPuff jawForward jawLeft jawOpen jawRight mouthClose mouthFunnel mouthLeft mouthPucker
        mouthRight mouthRollLower mouthRollUpper mouthShrugLower mouthShrugUpper tongueOut"""
    names = {*middle.split(), *(f"{name}{side}" for name in both.split() for side in ("Left", "Right"))}
    assert len(names) == 52
    assert {*Face(whole=True).deltas()} == names


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("variant", VARIANTS)
def test_patches_are_low_and_end_before_lids_and_lips(variant: str) -> None:
    face, path, found = suggested(variant)
    document = read_document(path)
    rig = read_rig(document, 0)
    surface = read_surface(document, rig)
    tools = parse_tools(found.text)
    rest = rest_pose(surface, rig, tools, (), [])
    for patch in attach_tools(list(tools.tools), surface, rest, rig, up="y"):
        # No wrinkle of a young face is higher than a millimetre and a half; the fold beside a mouth is up to two and a
        # half.
        high = "nasolabial" in patch.tool.name
        assert patch.greatest_height < (0.012 if high else 0.007) * face.height
        for name, rim in face.rims.items():
            u, v = patch.coordinates(rim)
            on = np.abs(patch.magnitudes(u, v, np.tile(patch.normal, (len(rim), 1)))) > 0.05
            assert not on.any(), (patch.tool.name, name)


@pytest.mark.slow
@pytest.mark.long
def test_what_is_written_passes_a_strict_check(tmp_path: Path) -> None:
    _, path, found = suggested(JUDGED)
    (tmp_path / "tools.yaml").write_text(found.text)
    assert check(path, tmp_path / "tools.yaml").warnings == ()


@pytest.mark.slow
@pytest.mark.long
def test_plain_names_do_what_they_can() -> None:
    found = suggest(sample("head"), face=True)
    assert [each.tool.name for each in found.tools] == ["forehead", "forehead_side.L", "glabella"]
    # The brows of the sample go down and not together: the weight makes the lines between them.
    assert isinstance(found.tools[2].tool.rest_length, RestLengthMorph)
    (note,) = (note for note in found.notes if "no such target" in note)
    assert note == (
        "head: no tool for crow's feet (cheekSquint, eyeSquint), bunny lines (noseSneer), the nasolabial fold"
        " (mouthSmile, cheekSquint), the chin (mouthShrugLower): it has no such target"
    )


@pytest.mark.slow
@pytest.mark.long
def test_targets_that_move_nothing_are_said(tmp_path: Path) -> None:
    face = Face()
    still = {
        name: 0.0 * each if "Sneer" in name else each
        for name, each in face.deltas().items()
        if "row" in name or "Sneer" in name
    }
    found = suggest(face.asset(still).write(tmp_path / "face.glb"), face=True)
    assert [each.tool.name for each in found.tools] == ["forehead", "forehead_side.L", "glabella"]
    assert any("bunny lines (noseSneer)" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("targets", "reason"),
    [
        (["mouthSmileLeft", "mouthSmileRight"], "tell neither eyes nor brows, or move no skin"),
        (["eyeBlinkLeft", "jawOpen", "mouthFrownLeft"], "no morph target compresses the skin where a face has lines"),
    ],
)
def test_a_face_that_says_too_little_has_nothing(tmp_path: Path, targets: list[str], reason: str) -> None:
    face = Face()
    every = face.deltas()
    asset = face.asset({name: every[name] for name in targets})
    # Without joints, nothing turns the head.
    for node in asset.gltf["nodes"]:
        node.pop("skin", None)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        for name in ("JOINTS_0", "WEIGHTS_0"):
            del primitive["attributes"][name]
    found = suggest(asset.write(tmp_path / "face.glb"), face=True)
    assert not found.tools
    assert reason in found.reason


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "expressions",
    [
        {"preset": {"happy": {"morphTargetBinds": [{"node": 0, "index": 999, "weight": 1}]}}},
        None,
        [],
        {"preset": []},
        {"preset": {"happy": None, "angry": {}, "blink": {"morphTargetBinds": {}}}},
        {"preset": {"happy": {"morphTargetBinds": [None, {}, {"node": 0}, {"node": 0, "index": "0", "weight": 1}]}}},
        {"preset": {"happy": {"morphTargetBinds": [{"node": 0, "index": True, "weight": 1}]}}},
        {"preset": {"happy": {"morphTargetBinds": [{"node": 0, "index": 0, "weight": "1"}]}}},
        {"custom": {"": {"morphTargetBinds": [{"node": 7, "index": 0, "weight": 1}]}}},
    ],
)
def test_malformed_expressions_say_nothing(tmp_path: Path, expressions: object) -> None:
    asset = Face().vrm()
    asset.gltf["extensions"]["VRMC_vrm"]["expressions"] = expressions
    found = suggest(asset.write(tmp_path / "face.glb"), face=True)
    assert not found.tools
    assert "no mesh has morph targets of a face" in found.reason


def test_an_asset_without_a_face_has_nothing(tmp_path: Path) -> None:
    result = run(sample("wrist"), "--face", "-o", tmp_path / "tools.yaml")
    assert result.exit_code == 1
    assert "nothing to suggest: no mesh has morph targets of a face: none has a name of ARKit (browInnerUp)" in str(
        result.exception
    )
    assert not (tmp_path / "tools.yaml").exists()


@pytest.mark.parametrize("scale", [0.1, 1.0, 7.0])
def test_eyes_below_brows_are_as_large_and_as_far_below_as_brows_are_wide(scale: float) -> None:
    """Brows along x from -1 to 1, times a scale, at which all lengths of the eyes grow alike."""
    across = np.linspace(-scale, scale, 101)
    sites: Any = SimpleNamespace(positions=np.stack([across, np.zeros(101), np.zeros(101)], axis=1))
    brows: Any = SimpleNamespace(weights=np.ones(101), middle=np.zeros(3))
    up, left = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    eyes = _eyes_below(brows, sites, up, left)
    apart = eyes.left - eyes.right
    assert apart[0] == pytest.approx(0.6 * 2.0 * scale, rel=0.1)
    assert apart[1:].tolist() == [0.0, 0.0]
    assert eyes.half_width == pytest.approx(0.25 * apart[0])
    assert (eyes.left + eyes.right) / 2.0 == pytest.approx([0.0, -0.35 * apart[0], 0.0])


@dataclass(frozen=True)
class Region:
    """A compressed region, moved."""

    normal: np.ndarray
    centre: np.ndarray


@dataclass(frozen=True)
class Furrow:
    """A candidate, moved."""

    region: Region
    origin: np.ndarray
    target: np.ndarray
    between: np.ndarray


@pytest.mark.parametrize(("mouth", "up"), [(-1.0, 0.0), (-0.9, 0.1), (-0.6, 0.2)])
@pytest.mark.parametrize("turned", [False, True])
def test_a_furrow_goes_up_until_it_ends_beside_the_mouth_but_half_its_width_at_most(
    mouth: float, up: float, turned: bool
) -> None:
    """A tool across x, whose furrow of 0.4 along y ends at -1, on a plane."""
    ends = [np.array([-0.1, -0.8, 0.0]), np.array([0.1, -0.8, 0.0])]
    origin, target = ends[::-1] if turned else ends
    ahead = np.array([0.0, 0.0, 1.0])
    none = np.zeros((0, 3))
    region = Region(ahead, np.array([0.0, -0.8, 0.0]))
    candidate: Any = Furrow(region, origin, target, none)
    face: Any = SimpleNamespace(
        up=np.array([0.0, 1.0, 0.0]),
        mouth=mouth,
        size=1.0,
        middle=np.zeros(3),
        mesh=SimpleNamespace(rest=SimpleNamespace(foot=lambda place: (place,))),
    )
    found = _beside_mouth(face, candidate, 0.4)
    for old, new in ((origin, found.origin), (target, found.target), (region.centre, found.region.centre)):
        assert new - old == pytest.approx([0.0, up, 0.0])
