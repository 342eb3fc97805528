"""What other people's software makes of baked files: the Khronos validator, three.js and glTF-Transform.

Samples always; real assets where the folder `shared/assets` lies beside the repository.
"""

import json
from collections import Counter
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

import wrinklecli
from kit.bakes import bake_config, baked
from kit.clients import compare_with_three, optimize, pose, pose_each, tidy, validate
from kit.places import ROOT
from kit.player import Floats, Gltf, Json
from kit.samples import config, sample
from kit.unencoded import Case, planned, unencoded
from wrinklecli.character.clip import clip_grid, read_clips
from wrinklecli.gltf.document import read_document

ASSETS = ROOT.parent / "shared" / "assets"
SAMPLES = {"wrist": "wrist", "head": "head", "head_keyed": "head", "trousers": "trousers"}
# Of bakes in frames, which are large.
FRAMES_PER_SECOND = 1.0
# Places where the mesh folds, rest pose, scene units.
TOOLS: dict[str, list[Json]] = {
    "hand": [
        {"name": "wrist", "origin": [-0.4622, 0.2576, 0.1750], "target": [-0.4838, 0.2355, 0.2126], "width": "100%"}
    ],
    "head_male": [
        {
            "name": "brow.L",
            "mirror": "x",
            "origin": [0.035, 0.845, 0.150],
            "target": [0.035, 0.905, 0.125],
            "width": 0.05,
            "strategy": "both_ends",
            "bumps": 5,
        }
    ],
    "trousers": [
        {
            "name": "knee.L",
            "mirror": "x",
            "origin": [0.095, -0.258, -0.026],
            "target": [0.101, -0.364, -0.020],
            "width": "120%",
            "bumps": 3,
        }
    ],
    # The fox is a hundred units long; behind its left hind leg, and behind the man's left knee.
    "fox": [{"name": "knee", "origin": [6.8, 26, -27], "target": [6.9, 17, -34], "width": 12, "bumps": 3}],
    "cesium_man": [
        {"name": "knee", "origin": [0.079, 0.40, -0.013], "target": [0.080, 0.28, -0.035], "width": 0.12, "bumps": 3}
    ],
    "simple_skin": [{"name": "bend", "origin": [-0.4, 0.6, 0.0], "target": [-0.4, 1.4, 0.0], "width": 0.8, "bumps": 2}],
}


def deforming(file: Gltf) -> int:
    (node,) = (k for k, each in enumerate(file.json["nodes"]) if "skin" in each and "mesh" in each)
    return node


def case(name: str, folder: Path) -> Case:
    """A sample by its tools file, or a real asset; skips where the assets are not there.

    An edge is halved once at most: other software does the same with a finer mesh, and takes three times as long.
    """
    path = folder / f"{name.replace('/', '_')}.yaml"
    if name in SAMPLES:
        asset = sample(SAMPLES[name])
        tools = config(name)
        tools["refinement"] |= {"max_levels": 1}
        path.write_text(yaml.safe_dump(tools))
        return Case(asset, path, deforming(Gltf(asset)))
    name = name.removeprefix("shared/")
    asset = next((ASSETS / f"{name}{end}" for end in (".glb", ".gltf") if (ASSETS / f"{name}{end}").exists()), None)
    if asset is None:
        pytest.skip(f"no {name} in {ASSETS}: real assets are not part of the repository")
    file = Gltf(asset)
    path.write_text(yaml.safe_dump({"version": 1, "refinement": {"max_levels": 1}, "tools": TOOLS[name]}))
    return Case(asset, path, deforming(file))


@cache
def made(name: str, mode: str, accessors: str, folder: Path) -> tuple[Case, Path]:
    found = case(name, folder)
    options: Json = {"mode": mode, "accessors": accessors}
    options |= {"fps": FRAMES_PER_SECOND} if mode == "frames" else {}
    return found, baked(found.asset, found.tools.read_text(), json.dumps(options))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("consumers")


def but(names: Iterable[str], *, slow: Iterable[str]) -> list[Any]:
    """Names of assets, of which some are large."""
    return [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in names]


ALL = [*SAMPLES, *(f"shared/{name}" for name in TOOLS)]
HEADS = ("head", "head_keyed", "shared/head_male")
LARGE = (*HEADS, "trousers")
# Its quaternions are not of unit length, which three.js takes as they are and compression mends.
PLAYED = [name for name in ALL if name != "shared/simple_skin"]


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", but(ALL, slow=LARGE))
def test_no_errors_and_no_new_kinds_of_warnings(name: str, folder: Path) -> None:
    kinds = [("morph", "sparse"), ("morph", "dense"), ("frames", "sparse")]
    # The keyed head differs from the other in its tracks alone.
    outputs = [made(name, *kind, folder)[1] for kind in (kinds[:1] if name == "head_keyed" else kinds)]
    source, *reports = validate([case(name, folder).asset, *outputs])
    assert not source.lines(severity=0), "the input is invalid itself"
    known = {message["code"] for message in source.messages}
    for report in reports:
        fresh = Counter(m["code"] for m in report.messages if m["severity"] <= 1 and m["code"] not in known)
        assert not fresh, "\n".join(report.lines())
        # Nor does an infringement of a known kind appear in what was valid.
        assert report.errors == 0, "\n".join(report.lines(severity=0))


def clip_times(file: Gltf, node: int, clip: int) -> Floats:
    """Keys of the weights, and times between them where heights bend most."""
    sampler = file.sampler(clip, node, "weights")
    assert sampler is not None
    keys, values = file.keys(clip, node)
    # Between keys that are a millisecond or two apart, nothing is promised.
    wide = np.diff(keys) >= 0.002
    steps = np.where(wide, np.abs(np.diff(values, axis=0)).max(axis=1), 0.0)
    steep = np.argsort(-steps, kind="stable")[: min(6, int(wide.sum()))]
    between = np.concatenate([keys[steep] + part * np.diff(keys)[steep] for part in (0.13, 0.5, 0.8)])
    tallest = keys[np.argsort(-values.max(axis=1), kind="stable")[:3]]
    return np.unique(
        np.concatenate([np.linspace(keys[0], keys[-1], 17), keys[:: 1 + len(keys) // 12], between, tallest])
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", but(PLAYED, slow=("head_keyed",)))
def test_three_js_puts_every_vertex_within_max_error(name: str, folder: Path) -> None:
    found, out = made(name, "morph", "sparse", folder)
    plan, file, acting = planned(found), Gltf(out), 0.0
    for clip in found.clips:
        if file.sampler(clip, found.node, "weights") is None:
            continue
        times = clip_times(file, found.node, clip)
        expected = unencoded(plan, found.asset, clip, times)
        shown = pose(out, node=found.node, clip=clip, times=times.tolist())
        gaps = np.linalg.norm(shown - expected, axis=2)
        worst = np.unravel_index(gaps.argmax(), gaps.shape)
        # three.js plays clips in float32, which counts where a keyframe's part of an interval is small.
        size = float(np.abs(expected).max())
        assert gaps[worst] < plan.max_error + 4e-7 * size, (clip, times[worst[0]], worst[1], plan.max_error)
        names = file.mesh(found.node)["extras"]["targetNames"]
        wrinkles = [k for k, each in enumerate(names) if each.startswith("wrinkle_")]
        acting = max(acting, float(np.abs(file.weights(found.node, clip, times)[:, wrinkles]).max()))
    assert acting > 0.1, "no tool acts in any clip: this compares nothing"


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", but(("wrist", "head", "shared/hand", "shared/fox"), slow=("head",)))
def test_three_js_reads_dense_and_sparse_alike(name: str, folder: Path) -> None:
    found, sparse = made(name, "morph", "sparse", folder)
    _, dense = made(name, "morph", "dense", folder)
    times = clip_times(Gltf(sparse), found.node, 0)[::5].tolist()
    one, other = (pose(out, node=found.node, clip=0, times=times) for out in (sparse, dense))
    assert np.array_equal(one, other)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["wrist", "trousers", "head", "shared/cesium_man"])
def test_the_players_of_these_tests_agree_with_three_js(name: str, folder: Path) -> None:
    found, out = made(name, "morph", "sparse", folder)
    file = Gltf(out)
    times = clip_times(file, found.node, 0)[::4]
    compare_with_three(out, found.node, 0, times.tolist(), file.pose(found.node, 0, times), tolerance=4e-6)


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", but(ALL, slow=LARGE))
def test_three_js_shows_the_frames_in_turn(name: str, folder: Path) -> None:
    """At a time between two frames the one that is due, as the method makes it, and none before or after it."""
    found, out = made(name, "frames", "sparse", folder)
    file, plan = Gltf(out), planned(found)
    for clip in found.clips:
        nodes, times = frames_of(file, found, clip)
        due = len(nodes) // 2
        near = [k for k in (due - 1, due, due + 1, 0) if 0 <= k < len(nodes)]
        shown = pose_each(out, [nodes[k] for k in near], clip=clip, times=[between(times, due)])
        assert [bool(np.ptp(each[0], axis=0).max() > 0) for each in shown] == [k == due for k in near]
        wanted = unencoded(plan, found.asset, clip, times[due : due + 1])
        gaps = np.linalg.norm(shown[near.index(due)] - wanted, axis=2)
        assert gaps.max() < 1e-6 * np.abs(wanted).max()


def frames_of(file: Gltf, found: Case, clip: int) -> tuple[list[int], Floats]:
    """The nodes that show a clip's frames in turn, and the times from which on they do."""
    (source,) = (each for each in read_clips(read_document(found.asset)) if each.index == clip)
    times = clip_grid(source, None, fps=FRAMES_PER_SECOND)
    names = [each.get("name") for each in file.json["nodes"]]
    first = names.index(f"{planned(found).rig.names[found.node]}_{source.name}_0000")
    return list(range(first, first + len(times))), times


def between(times: Floats, due: int) -> float:
    """A time when a frame is due and no new one begins."""
    return float(times[due] + 0.3 * (times[due + 1] - times[due]) if due + 1 < len(times) else times[due])


def quantization(file: Gltf, node: int, clip: int, times: Floats) -> float:
    """How far glTF-Transform's defaults may move a vertex, scene units: 14-bit positions and deltas, 8-bit weights."""
    positions, deltas = file.attribute(node, "POSITION"), file.deltas(node)
    step = max(float(np.ptp(each.reshape(-1, 3), axis=0).max()) for each in (positions, deltas)) / 2**14
    acting = float(np.abs(file.weights(node, clip, times)).sum(axis=1).max())
    skin = file.json["skins"][file.json["nodes"][node]["skin"]]
    inverse = file.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    palette = file.matrices(clip, times)[:, skin["joints"]] @ inverse
    joints, weights = (file.attribute(node, f"{kind}_0") for kind in ("JOINTS", "WEIGHTS"))
    # Where each of a vertex's joints would take it: a share of 1/255 goes from one to another.
    places = np.stack(
        [
            np.einsum("tvab,vb->tva", palette[:, joint, :3, :3], positions) + palette[:, joint][..., :3, 3]
            for joint in joints.astype(int).T
        ]
    )
    places = np.where((weights > 0).T[:, None, :, None], places, places[:1])
    spread = float(np.linalg.norm(np.ptp(places, axis=0), axis=2).max())
    # Resampled keys: each number may be off by 1e-4, rotations at an arm's length of the mesh's size.
    size = float(np.linalg.norm(np.ptp(positions, axis=0)))
    resampled = 1e-4 * (size * len(skin["joints"]) + acting * float(np.abs(deltas).max()))
    return 3**0.5 * step * (1 + acting) / 2 + spread / 255 * joints.shape[1] / 2 + resampled


@pytest.mark.slow
@pytest.mark.parametrize("name", but(PLAYED, slow=LARGE))
def test_gltf_transform_reads_and_optimizes_a_bake(name: str, folder: Path, tmp_path: Path) -> None:
    """Merged, reordered, quantised and compressed, each vertex still goes where some vertex of the bake goes."""
    found, out = made(name, "morph", "sparse", folder)
    file, small = Gltf(out), tmp_path / "small.glb"
    report = optimize(out, small)
    (mesh,) = (
        each
        for each in report["meshes"]["properties"]
        if each["vertices"] == len(file.attribute(found.node, "POSITION"))
    )
    assert mesh["glPrimitives"] == len(file.triangles(found.node))
    assert [each["channels"] for each in report["animations"]["properties"]] == [
        len(each["channels"]) for each in file.json["animations"]
    ]
    document = read_document(small)
    (node,) = (k for k, each in enumerate(document.items("nodes")) if "skin" in each and "mesh" in each)
    after, before = document.items("nodes")[node], file.json["nodes"][found.node]
    assert after["extras"] == before["extras"]
    mesh_after = document.items("meshes")[after["mesh"]]
    assert mesh_after["extras"]["targetNames"] == file.mesh(found.node)["extras"]["targetNames"]
    assert len(mesh_after["primitives"][0]["targets"]) == len(mesh_after["extras"]["targetNames"])
    assert small.stat().st_size < out.stat().st_size
    assert not validate([small])[0].lines(severity=0)
    for clip in found.clips:
        if file.sampler(clip, found.node, "weights") is None:
            continue
        times = clip_times(file, found.node, clip)[::3]
        tolerance = quantization(file, found.node, clip, times)
        assert tolerance < planned(found).tallest, "wrinkles could be lost without notice"
        wanted = pose(out, node=found.node, clip=clip, times=times.tolist())
        shown = pose(small, node=node, clip=clip, times=times.tolist())
        flat = [each.transpose(1, 0, 2).reshape(each.shape[1], -1) for each in (wanted, shown)]
        for one, other in (flat, flat[::-1]):
            _, nearest = cKDTree(other).query(one)
            gaps = np.linalg.norm((one - other[nearest]).reshape(len(one), -1, 3), axis=2)
            assert gaps.max() < tolerance, (clip, gaps.max(), tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wrist", "trousers", "touch"])
def test_what_the_page_advises_keeps_wrinkles(name: str, tmp_path: Path) -> None:
    """`gltf-transform optimize` by the line of samples/README.md, vertices in other orders and fewer."""
    assert "`gltf-transform optimize` by the line below" in (ROOT / "samples" / "README.md").read_text()
    file, out = bake_config(name, name), tmp_path / "tidy.glb"
    tidy(file.path, out)
    assert not np.array_equal(Gltf(out).triangles(name), file.triangles(name))
    found = wrinklecli.diff(file.path, out, posed=True, fps=5)
    assert found.worst is not None
    assert found.worst.distance < 1e-6 * found.size


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", but(ALL, slow=(*LARGE, "shared/fox", "shared/cesium_man")))
def test_gltf_transform_reads_and_optimizes_frames(name: str, folder: Path, tmp_path: Path) -> None:
    """The frame that is due is the same but for 14-bit positions, and it alone is shown."""
    found, out = made(name, "frames", "sparse", folder)
    file, small = Gltf(out), tmp_path / "small.glb"
    report = optimize(out, small)
    assert len(report["meshes"]["properties"]) == len(file.json["meshes"])
    assert small.stat().st_size < out.stat().st_size
    assert not validate([small])[0].lines(severity=0)
    after = read_document(small).items("nodes")
    names = [each.get("name") for each in after]
    for clip in found.clips:
        nodes, times = frames_of(file, found, clip)
        due = len(nodes) // 2
        near = [k for k in (due - 1, due, due + 1, 0) if 0 <= k < len(nodes)]
        late = [between(times, due)]
        (wanted,) = pose_each(out, [nodes[due]], clip=clip, times=late)
        carriers = []
        for k in near:
            twin = names.index(file.json["nodes"][nodes[k]]["name"])
            # Quantised positions get a node of their own below one that is animated.
            carriers.append(twin if "mesh" in after[twin] else after[twin]["children"][0])
        shown = pose_each(small, carriers, clip=clip, times=late)
        assert [bool(np.ptp(each[0], axis=0).max() > 0) for each in shown] == [k == due for k in near]
        one, other = wanted[0], shown[near.index(due)][0]
        tolerance = 3**0.5 * float(np.ptp(one, axis=0).max()) / 2**14
        assert max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max()) < tolerance
