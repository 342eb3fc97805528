"""Flesh from the tools file to the player: proof, limits, what is refused, and the driver."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.asset import Array, Asset, Json
from kit.bakes import bake_once, place, report_of
from kit.clients import assert_valid, compare_with_three, drive
from kit.flesh import SECONDS, bob, bob_share, body, jump, region
from kit.player import Gltf
from truth.flesh import compare, trunk
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.baking.track import track
from wrinklecli.character.clip import Channel, Clip, read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.effects.flesh import tissue as tissue_module
from wrinklecli.effects.flesh.attach import _spring
from wrinklecli.effects.flesh.tissue import swings_of
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.read import parse_tools


@pytest.fixture(scope="module")
def bodies() -> dict[int, Path]:
    """The trunk with so many keys a second."""
    return {keys: place(body(keys=keys)) for keys in (60, 30, 29, 8)} | {0: place(body(None))}


def baked(asset: Path, *regions: Json, **options: Any) -> Gltf:
    return bake_once(asset, top={"flesh": list(regions)}, **options)


@pytest.mark.slow
def test_six_springs_move_as_all_elements_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few nodes resolve the shapes badly; the record of all of them, with a sway, is in `truth`: 3 and 2 %."""
    monkeypatch.setattr(tissue_module, "NODES", 300)
    tissue = swings_of(*trunk(20, 24), 3).tissue
    found = compare(tissue, "jump", (6,))[6]
    assert found.greatest < 0.1
    assert found.rms < 0.07


@pytest.mark.slow
def test_a_jump_makes_a_belly_swing(bodies: dict[int, Path]) -> None:
    """The file is proven by the bake; here: weights in [0, 1], still at the beginning, moved by the landing."""
    file = baked(bodies[60], region(limit=0.025))
    _, values = file.keys("jump", "trunk")
    names = file.mesh("trunk")["extras"]["targetNames"]
    assert names == [f"wrinkle_belly_{number}" for number in range(1, 8)]
    assert values.min() >= 0.0
    assert values.max() <= 1.0
    moved = np.linalg.norm(np.einsum("ft,tvx->fvx", values, file.deltas("trunk")), axis=2)
    assert 0.012 < moved.max() < 0.027
    # A loop: what is left of the landing is still there.
    assert moved[0].max() == pytest.approx(moved[-1].max(), rel=0.02)
    # Skin beyond the region keeps its place, to the bit.
    positions = file.attribute("trunk", "POSITION")
    far = np.linalg.norm(positions - [0.0, -0.05, 0.18], axis=1) > 0.14
    assert not file.deltas("trunk")[:, far].any()
    assert_valid(file.path)


@pytest.mark.slow
@pytest.mark.long
def test_a_region_has_an_error_bound_of_its_own(bodies: dict[int, Path]) -> None:
    """A looser bound takes fewer keys, and a tighter one more; a per cent is of the region's limit."""
    auto, loose, tight = (
        baked(bodies[60], region(limit=0.025, shapes=3, **asked))
        for asked in ({}, {"max_error": "8%"}, {"max_error": 0.00005})
    )
    counts = [len(each.keys("jump", "trunk")[0]) for each in (loose, auto, tight)]
    assert counts[0] < 0.8 * counts[1]
    assert counts[1] < 0.8 * counts[2]


@pytest.mark.slow
def test_flesh_plays_in_three(bodies: dict[int, Path]) -> None:
    file, times = baked(bodies[60], region()), np.linspace(0.0, SECONDS, 7)
    compare_with_three(file.path, "trunk", "jump", times.tolist(), file.pose("trunk", "jump", times))


def frame_times(fps: int | None) -> Array:
    """Seconds of so many frames a second; None is a player whose frames take from 7 to 33 ms."""
    if fps is not None:
        return np.arange(int(SECONDS * fps)) / fps
    steps = np.random.default_rng(1).choice([1 / 144, 1 / 90, 1 / 60, 1 / 45, 1 / 30], 300)
    times = np.cumsum(steps) - steps[0]
    return np.asarray(times[times < SECONDS])


def sway(times: Array) -> Array:
    """(times, 3) places to which a player moves a body beside its clip: wider and wider rounds, one a second."""
    wide, turn = 0.1 * (1 - np.cos(np.pi * times / 2)), 2 * np.pi * times
    return np.stack([wide * np.sin(turn), 0 * times, wide * np.cos(turn)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "keys"), [(15, 29), (30, 60), (60, 29), (120, 60), (None, 29)])
def test_the_driver_plays_flesh_at_any_frame_rate(bodies: dict[int, Path], keys: int, fps: int | None) -> None:
    """A second round of the clip is as it was baked: the driver knows the curve through the clip's keys.

    At 29 keys a second no key lies at a quarter of the clip.
    """
    file, times = baked(bodies[keys], region(limit=0.026)), frame_times(fps)
    elapsed = [*np.diff(times, prepend=0.0), SECONDS - times[-1], *np.diff(times)]
    found = drive(file.path, node="trunk", clip="jump", times=[*times, *times], elapsed=elapsed, driver=True)
    assert_alike(found, swung(file.path)(times), len(times), 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("fps", [30, 60, 144, None])
def test_the_driver_plays_a_motion_of_the_player(bodies: dict[int, Path], fps: int | None) -> None:
    """The player jumps with a body whose clip stays in place, or moves one that jumps by itself; neither is a loop."""
    times = frame_times(fps)
    steps = {
        "node": "trunk",
        "driver": True,
        "times": times.tolist(),
        "elapsed": np.diff(times, prepend=-1 / 60).tolist(),
    }
    still, jumps = (baked(bodies[keys], region(limit=0.026)).path for keys in (0, 30))
    own = drive(still, clip=None, places=jump(times).tolist(), **steps)
    both = drive(jumps, clip="jump", places=sway(times).tolist(), **steps)
    for found, motion in ((own, jump), (both, lambda at: jump(at) + sway(at))):
        assert_alike(found, swung(still, motion)(times), 0, 0.02)


@pytest.mark.quick(1)
@pytest.mark.parametrize("fps", [30, 60, 144, None])
def test_the_driver_plays_clips_that_blend(bodies: dict[int, Path], fps: int | None) -> None:
    """It follows both curves, each by its share; uneven frames tell least of how the shares change."""
    times = frame_times(fps)
    shares = bob_share(times)
    file = baked(place(body(keys=30, bobs=True)), region(limit=0.026)).path
    found = drive(
        file,
        node="trunk",
        clip="jump",
        driver=True,
        times=times.tolist(),
        elapsed=np.diff(times, prepend=-1 / 60).tolist(),
        into=("bob", shares.tolist()),
    )

    def blend(at: Array) -> Array:
        share = bob_share(at)[:, None]
        return (1.0 - share) * jump(at) + share * bob(at)

    assert_alike(
        found, swung(baked(bodies[0], region(limit=0.026)).path, blend)(times), 0, 0.035 if fps is None else 0.02
    )


def test_twice_the_keys_of_an_unknown_clip_leave_a_quarter_of_the_error(bodies: dict[int, Path]) -> None:
    """It sees a body on straight lines: each corner is a blow, and the corners get flatter.

    The limit is far away here: near to it, blows are damped one by one.
    """
    still, times = baked(bodies[0], region(limit=0.5)).path, frame_times(144)
    wanted, errors = swung(still, jump)(times), []
    for keys in (15, 30):
        at = np.linspace(0.0, SECONDS, round(SECONDS * keys) + 1)
        places = np.stack([np.interp(times, at, axis) for axis in jump(at).T], axis=1)
        elapsed = np.diff(times, prepend=-1 / 144).tolist()
        steps = {"times": times.tolist(), "elapsed": elapsed, "places": places.tolist()}
        found = drive(still, node="trunk", clip=None, driver=True, **steps)
        played = np.stack([found[f"wrinkle_belly_{number + 1}"][:, 0] for number in range(wanted.shape[1])], axis=1)
        errors.append(np.abs(played - wanted).max() / wanted.max())
    assert 0.1 < errors[0] < 0.2
    assert errors[1] == pytest.approx(errors[0] / 4.0, rel=0.2)


def assert_alike(found: dict[str, Array], wanted: Array, first: int, error: float) -> None:
    """The weights of each frame, from the first that counts."""
    for number, column in enumerate(wanted.T, start=1):
        beside = np.abs(found[f"wrinkle_belly_{number}"][first:, 0] - column)
        assert beside.max() < error * wanted.max(), (number, beside.argmax())


def swung(path: Path, motion: Callable[[Array], Array] | None = None) -> Signal:
    """Weights of the belly in its clip, or in a motion after which the body goes on as it was: no loop."""
    document = read_document(path)
    rig = read_rig(document, 0)
    (stored,) = read_bodies(document)[0].drives
    clips = read_clips(document)
    if motion is not None:
        at = np.linspace(0.0, SECONDS, 121)
        turns = np.stack([0.0 * at, 0.001 * at, 0.0 * at, 0.0 * at + 1.0], axis=1)
        channels = (
            Channel(0, 1, "translation", at, motion(at), "LINEAR"),
            Channel(1, 1, "rotation", at, turns, "LINEAR"),
        )
        clips = (Clip(0, "jump", channels, float(at[0]), float(at[-1])),)
    return stored.on({"hips": 1}, []).weights_in(rig, clips[0])


def test_a_clip_of_another_file_is_tracked(bodies: dict[int, Path], tmp_path: Path) -> None:
    whole, still = baked(bodies[60], region()), baked(bodies[0], region())
    (made,) = track(still.path, [bodies[60]], tmp_path)
    times, values = Gltf(Path(made.path)).keys("jump", "trunk")
    assert np.abs(values - whole.weights("trunk", "jump", times)).max() < 0.02


@pytest.mark.slow
@pytest.mark.long
def test_regions_that_touch_add_up(bodies: dict[int, Path]) -> None:
    """Each alone moves the skin as both together do; where they meet, moves are as smooth as in the middle."""
    left, right = (region(name=name, at=[x, -0.05, 0.17], radius=0.1) for name, x in (("l", 0.06), ("r", -0.06)))
    both = baked(bodies[60], left, right)
    alone = [baked(bodies[60], each) for each in (left, right)]
    deltas = np.concatenate([each.deltas("trunk") for each in alone])
    assert np.allclose(both.deltas("trunk"), deltas, atol=1e-7)


@pytest.mark.slow
@pytest.mark.long
def test_mirrored_regions_are_mirror_images(bodies: dict[int, Path]) -> None:
    file = baked(bodies[60], region(name="side.L", at=[0.08, -0.05, 0.15], radius=0.1, mirror="x"))
    first, second = np.linalg.norm(file.deltas("trunk"), axis=2).max(axis=1).reshape(2, 7)
    # The last is minus the sum of the others, whose signs are free.
    assert first[:-1] == pytest.approx(second[:-1], rel=0.01)


@pytest.mark.slow
@pytest.mark.long
def test_a_joint_outlines_a_region(bodies: dict[int, Path]) -> None:
    """All skin of the joint swings, up to the bones; a named joint must be there."""
    file = baked(bodies[60], {"name": "all", "joint": "hips"})
    moved = np.linalg.norm(file.deltas("trunk"), axis=2).max(axis=0)
    assert (moved > 0).mean() > 0.9


@pytest.mark.slow
def test_flesh_carries_wrinkles(bodies: dict[int, Path]) -> None:
    """A tool on the belly is stretched and pressed as the belly swings up and down."""
    tool = {"name": "fold", "origin": [0.0, 0.0, 0.17], "target": [0.0, -0.09, 0.17], "width": 0.1, "bumps": 2}
    file = bake_once(bodies[60], tool, top={"flesh": [region(limit=0.03)]})
    names = file.mesh("trunk")["extras"]["targetNames"]
    values = file.weights("trunk", "jump", np.linspace(0.0, SECONDS, 60))
    assert values[:, names.index("wrinkle_fold_1")].max() > 0.05


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius": 2.0}, "larger than the body allows"),
        ({"at": [0.0, 0.0, 0.6]}, "from the mesh, more than half of its radius"),
        ({"at": [0.02, -0.03, 0.17], "radius": 0.008}, "holds no flesh"),
        ({"frequency": 10_000}, "found 10000, expected a number from 0.5 to 20"),
        ({"shapes": 5}, "found 5, expected 3, 6 or 9"),
        ({"joint": "hip"}, "no joint of this mesh is named 'hip'; did you mean 'hips'?"),
        ({"gravity": "300%"}, "expected a percentage from 0% to 100%"),
        ({"mask": {"attribute": "_FLESH"}}, "has no _FLESH"),
    ],
    ids=str,
)
def test_what_does_not_fit_is_one_line(bodies: dict[int, Path], tmp_path: Path, changes: Json, message: str) -> None:
    import yaml

    path = tmp_path / "tools.yaml"
    path.write_text(yaml.safe_dump({"version": 1, "flesh": [region(**changes)]}))
    with pytest.raises(WrinkleError) as refused:
        wrinklecli.bake(bodies[60], path, tmp_path / "out.glb")
    (line,) = str(refused.value).splitlines()
    assert message in line
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.slow
def test_warnings_say_what_a_clip_does_not_hold(bodies: dict[int, Path]) -> None:
    def said(asset: Path) -> str:
        return "\n".join(report_of(baked(asset, region())).data["warnings"])

    assert "has 8 keys a second" in said(bodies[8])
    assert "there is no clip" in said(bodies[0])
    still = place(body(lambda times: np.zeros((len(times), 3))))
    assert "holds no motion of the root" in said(still)
    assert said(bodies[60]) == ""


def stepping(ahead: float, lift: float, *, swings: bool = True) -> Asset:
    """The trunk on two legs that step by 0.6 m in a second, one after the other, while hips go ahead."""
    asset, times = body(None), np.linspace(0.0, 1.0, 31)
    legs = [
        asset.append("nodes", {"name": f"foot.{side}", "translation": [x, -0.95, 0]})
        for side, x in zip("LR", (0.1, -0.1), strict=True)
    ]
    head = asset.append("nodes", {"name": "head", "translation": [0, 0.6, 0]})
    asset.gltf["nodes"][1]["children"] = [*legs, head]
    asset.gltf["skins"][0]["joints"] = [1, *legs, head]
    animation: Json = {"name": "step"}
    asset.channel(
        animation,
        1,
        "translation",
        times,
        np.outer(times, [0.0, 0.0, ahead]) + np.outer(0.03 * np.sin(4 * np.pi * times), [0, 1, 0]),
    )
    for leg, shift, x in zip(legs, (0.0, 0.5), (0.1, -0.1), strict=True):
        phase = (times + shift) % 1.0
        # It stands for the first half, and swings back in the second.
        along = np.where(phase < 0.5, 0.3 - 1.2 * phase, -0.3 + 1.2 * (phase - 0.5)) if swings else 0.0 * phase
        up = lift * np.sin(np.pi * np.clip(2.0 * phase - 1.0, 0.0, 1.0))
        asset.channel(animation, leg, "translation", times, np.stack([x + 0.0 * times, up - 0.95, along], axis=1))
    asset.append("animations", animation)
    return asset


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(
    ("asset", "lines"),
    [
        (stepping(0.0, 0.1), 1),  # a walk in place
        (stepping(1.2, 0.1), 0),  # the same walk with its root
        (stepping(2.5, 0.1, swings=False), 0),  # a glide ahead, on feet that go along
        (stepping(0.0, 0.0, swings=False), 0),  # an idle, in which the body goes up and down
        (stepping(0.0, 0.3, swings=False), 0),  # a gesture, with one foot after the other
    ],
    ids=["in place", "ahead", "glide", "idle", "gesture"],
)
def test_one_warning_names_clips_in_place(asset: Asset, lines: int) -> None:
    """A walk on the spot moves the hips, and lacks the motion of the root all the same; all regions share the line."""
    regions = [region(name=name, at=[x, -0.05, 0.17], radius=0.1, shapes=3) for name, x in (("l", 0.06), ("r", -0.06))]
    said = [each for each in report_of(baked(place(asset), *regions)).data["warnings"] if "in place" in each]
    assert len(said) == lines
    assert all(each.startswith("l, r: 'step' is in place") for each in said)


@pytest.mark.slow
def test_a_bake_without_flesh_imports_none_of_it() -> None:
    """Its solver would take longer to import than a small bake takes."""
    import subprocess
    import sys

    code = "import sys, wrinklecli.effects.plan; print('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


def test_a_warning_names_clothes_over_a_region() -> None:
    """A shirt that lies over the belly stays in place; an eye within the body, or a hat above it, is no matter."""
    asset = body(None, normals=False)
    skin = trunk(20, 24)[0].positions
    for name, places in (("shirt", 1.05 * skin), ("eye", 0.5 * skin), ("hat", skin + np.array([0.0, 1.0, 0.0]))):
        attributes = {"POSITION": asset.accessor(places, bounds=True)}
        mesh = asset.append("meshes", {"primitives": [{"attributes": attributes, "mode": 0}]})
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": name, "mesh": mesh}))
    said = report_of(baked(place(asset), region(node="trunk"))).data["warnings"]
    assert [each for each in said if " over it " in each] == [
        "belly: 'shirt' over it stays in place: the skin may come through; `meshes` lets clothes move along"
    ]


def dressed(waist: float | None = None) -> Path:
    """The trunk that jumps, with a shirt whose vertices are apart from the skin's; with a skirt below a waist."""
    asset, clothes = body(normals=False), trunk(17, 21)[0]
    upper = clothes.positions[clothes.triangles, 1].mean(axis=1) > (-np.inf if waist is None else waist)
    for name, part in (("shirt", clothes.triangles[upper]), ("skirt", clothes.triangles[~upper])):
        if len(part):
            used, indices = np.unique(part, return_inverse=True)
            attributes = {
                "POSITION": asset.accessor(1.06 * clothes.positions[used], bounds=True),
                "JOINTS_0": asset.accessor(np.zeros((len(used), 4)), "u1"),
                "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (len(used), 1))),
            }
            primitive = {"attributes": attributes, "indices": asset.accessor(indices.reshape(-1), "u2")}
            mesh = asset.append("meshes", {"primitives": [primitive]})
            node = asset.append("nodes", {"name": name, "mesh": mesh, "skin": 0})
            asset.gltf["scenes"][0]["nodes"].append(node)
    return place(asset)


@pytest.mark.slow
def test_clothes_do_not_tear_off_others_that_stay() -> None:
    """A shirt that is sewn to a skirt that stays moves less towards the seam; it moves fully if both do."""
    path = dressed(waist=-0.03)
    alone, both = (baked(path, region(node="trunk", meshes=worn, shapes=3)) for worn in (["shirt"], ["shirt", "skirt"]))
    shirt, skirt = (both.attribute(node, "POSITION") for node in ("shirt", "skirt"))
    fading, moving, below = (
        np.linalg.norm(file.deltas(node), axis=2).max(axis=0)
        for file, node in ((alone, "shirt"), (both, "shirt"), (both, "skirt"))
    )
    apart = np.linalg.norm(shirt[:, None] - skirt[None], axis=2)
    seam = apart.min(axis=1) == 0
    assert moving[seam].max() > 0.5 * moving.max()
    assert moving[seam] == pytest.approx(below[apart[seam].argmin(axis=1)])
    assert not fading[seam].any()
    far = apart.min(axis=1) > 0.25 * 0.13
    assert moving[far].max() > 0.5 * moving.max()
    assert fading[far] == pytest.approx(moving[far])


def test_clothes_move_with_the_skin_below() -> None:
    """Each vertex of a shirt moves as the skin nearest to it does, by the same weights; the bake proves both meshes."""
    path = dressed()
    file = baked(path, region(node="trunk", meshes=["shirt"]))
    times = np.linspace(0.0, SECONDS, 31)
    weights = [file.weights(node, "jump", times) for node in ("trunk", "shirt")]
    assert np.abs(weights[0] - weights[1]).max() < 0.02
    moved = [np.einsum("ft,tvx->fvx", weights[0], file.deltas(node)) for node in ("trunk", "shirt")]
    skin, cloth = (file.attribute(node, "POSITION") for node in ("trunk", "shirt"))
    nearest = np.linalg.norm(cloth[:, None] - skin[None], axis=2).argmin(axis=1)
    limit = 0.12 * 0.13
    assert np.abs(moved[1]).max() > 0.3 * limit
    assert np.linalg.norm(moved[1] - moved[0][:, nearest], axis=2).max() < 0.35 * np.linalg.norm(moved[0], axis=2).max()
    assert not [each for each in report_of(file).data["warnings"] if "over it" in each]
    compare_with_three(file.path, "shirt", "jump", times[::5].tolist(), file.pose("shirt", "jump", times[::5]))
    steps = {"times": (at := np.arange(60) / 60).tolist(), "elapsed": np.diff(at, prepend=-1 / 60).tolist()}
    played = [drive(file.path, node=node, clip="jump", driver=True, **steps) for node in ("trunk", "shirt")]
    assert played[0].keys() == played[1].keys()
    for name, weights_of_skin in played[0].items():
        assert np.array_equal(weights_of_skin, played[1][name]), name


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"meshes": ["shrit"]}, "node 'shrit' is no node with a mesh; did you mean 'shirt'?"),
        ({"meshes": ["trunk"]}, "'trunk' is the mesh of the region itself; name meshes over it"),
        ({"meshes": "shirt"}, "expected a list of node names"),
    ],
    ids=str,
)
def test_clothes_that_do_not_fit_are_one_line(tmp_path: Path, changes: Json, message: str) -> None:
    import yaml

    path = tmp_path / "tools.yaml"
    path.write_text(yaml.safe_dump({"version": 1, "flesh": [region(node="trunk", **changes)]}))
    with pytest.raises(WrinkleError) as refused:
        wrinklecli.bake(dressed(), path, tmp_path / "out.glb")
    (line,) = str(refused.value).splitlines()
    assert message in line


@pytest.mark.parametrize("faster", [1.0, 1.5, 4.0])
def test_what_swings_faster_is_damped_more(faster: float) -> None:
    """Damping in proportion to stiffness, as of tissue: the time in which a swing fades falls with the square."""
    file = {"version": 1, "flesh": [region(frequency=2.5, damping=0.2)]}
    (tool,) = parse_tools(json.dumps(file), name="tools.yaml").effects
    assert isinstance(tool, Flesh)
    slowest, spring = _spring(tool, 1.0), _spring(tool, faster)
    assert (slowest.speed, slowest.damping) == pytest.approx((2.0 * np.pi * 2.5, 0.2))
    assert spring.speed * spring.damping == pytest.approx(faster**2 * slowest.speed * slowest.damping)
