"""Every form of input that glTF 2.0 allows: it bakes, validly, within --max-error, and all else is as it was.

Each asset is the limb of `kit.limb`, written in another way.
"""

import json
import os
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

import wrinklecli
from kit.asset import ARRAY_BUFFER, COMPONENTS, ELEMENT_ARRAY_BUFFER, Asset
from kit.bakes import place
from kit.clients import assert_valid, validate
from kit.limb import LENGTH, RADIUS, limb_asset, tool, write_tools
from kit.player import Gltf, Json, differences
from kit.player import wrinkle_columns as columns_of
from kit.unencoded import Case, planned, unencoded
from kit.variants import PNG, crowd, scattered
from wrinklecli.errors import AssetError

Array = np.ndarray[Any, Any]
Change = Callable[[Asset], None]

# An error to the validator, which adds up each WEIGHTS_n by itself; players read such files all the same.
KNOWN = frozenset({"ACCESSOR_WEIGHTS_NON_NORMALIZED"})
TOOL = tool(bumps=3)


def bake(path: Path, *tools: Json, out: str = "out/baked.glb", **options: Any) -> Path:
    """Bake beside the asset, or into a folder below."""
    target = path.parent / out
    target.parent.mkdir(exist_ok=True)
    wrinklecli.bake(path, write_tools(path.parent / "tools.yaml", *(tools or (TOOL,))), target, **options)
    return target


def check(
    asset: Asset | Path, *tools: Json, node: str = "limb", acts: bool = True, known: frozenset[str] = frozenset()
) -> tuple[Gltf, Gltf]:
    """Bake an asset and hold the result against all that this page promises.

    Args:
        asset: To bake.
        tools: On the limb.
        node: That carries the mesh.
        acts: Whether the tools make wrinkles in some clip.
        known: Codes of the validator's errors that the input has, and the output may have.

    Returns:
        The file before and after.
    """
    path = place(asset) if isinstance(asset, Asset) else asset
    out = bake(path, *tools)
    reports = validate([path, out])
    for report in reports:
        assert not [m for m in report.messages if m["severity"] == 0 and m["code"] not in known], report.lines()
    codes = [{m["code"] for m in report.messages if m["severity"] <= 1} for report in reports]
    assert not codes[1] - codes[0], reports[1].lines()
    before, after = Gltf(path), Gltf(out)
    assert_right(before, after, node, acts=acts)
    assert_rest_kept(before, after, node)
    return before, after


def assert_right(before: Gltf, after: Gltf, node: str, *, acts: bool = True) -> None:
    """The file plays as the method has it, and beside the wrinkles as before."""
    index = after.node(node)
    plan = planned(Case(before.path, before.path.parent / "tools.yaml", index))
    old, moved = old_vertices(before, after, node), moved_vertices(after, node)
    acting = 0.0
    for clip in range(len(after.json.get("animations", []))):
        if after.sampler(clip, index, "weights") is None:
            continue
        keys, weights = after.keys(clip, node)
        acting = max(acting, float(np.abs(weights[:, columns_of(after, node)]).max(initial=0.0)))
        times = np.unique(np.concatenate([np.linspace(keys[0], keys[-1], 23), keys[:: 1 + len(keys) // 8]]))
        shown = after.pose(node, clip, times)
        size = float(np.abs(shown).max())
        gaps = np.linalg.norm(shown - unencoded(plan, before.path, clip, times), axis=2)
        assert gaps.max() <= plan.max_error + 4e-7 * size, (clip, gaps.max(), plan.max_error)
        flat = ~moved[old]
        beside = np.abs(shown[:, old] - before.pose(node, clip, times))[:, flat]
        assert beside.max(initial=0.0) <= 2e-6 * size, "a vertex beside the wrinkles moves otherwise than before"
    assert not acts or acting > 0.1, "no tool acts in any clip: this compares nothing"


def counts(file: Gltf, node: str) -> list[int]:
    """Vertices of each primitive."""
    primitives = file.mesh(node)["primitives"]
    return [file.json["accessors"][each["attributes"]["POSITION"]]["count"] for each in primitives]


def old_vertices(before: Gltf, after: Gltf, node: str) -> Array:
    """The vertices of the output that were there before, all primitives one after another."""
    starts = np.cumsum([0, *counts(after, node)])
    kept = [start + np.arange(count) for start, count in zip(starts, counts(before, node), strict=False)]
    return np.concatenate(kept)


def moved_vertices(file: Gltf, node: str) -> Array:
    """(vertices,) which a wrinkle moves."""
    moved: Array = file.deltas(node)[columns_of(file, node)].any(axis=(0, 2))
    return moved


def touched(file: Gltf, node: str, *, mesh: bool) -> Iterator[int]:
    """The accessors of a node's mesh, where it counts, and of its weight channels."""
    for primitive in file.mesh(node)["primitives"] if mesh else []:
        yield from primitive["attributes"].values()
        yield from (index for target in primitive.get("targets", []) for index in target.values())
        yield from [primitive["indices"]] if "indices" in primitive else []
    for clip in range(len(file.json.get("animations", []))):
        sampler = file.sampler(clip, file.node(node), "weights")
        yield from (sampler["input"], sampler["output"]) if sampler else ()


def assert_rest_kept(before: Gltf, after: Gltf, node: str) -> None:
    """Whole documents are compared; what may differ is listed, and data that is not the mesh's is the same bytes."""
    index = after.node(node)
    mesh, animations = after.json["nodes"][index]["mesh"], after.json.get("animations", [])
    samplers = {
        f"/animations/{clip}/{kind}/{len(old[kind])}"
        for clip, old in enumerate(before.json.get("animations", []))
        for kind in ("samplers", "channels")
    }
    widened = {
        f"/animations/{clip}/samplers/{number}/{key}"
        for clip, animation in enumerate(animations)
        for number in {c["sampler"] for c in animation["channels"] if c["target"].get("node") == index}
        if {c["target"]["path"] for c in animation["channels"] if c["sampler"] == number} == {"weights"}
        for key in ("input", "output", "interpolation")
    }
    allowed = [
        r"/buffers(/0/byteLength|/0/uri|/\d+)?",
        r"/bufferViews/\d+(/byteOffset|/buffer)",
        rf"/meshes/{mesh}/primitives/\d+/(targets|indices|mode)(/.*)?",
        rf"/meshes/{mesh}/primitives/\d+/attributes/\w+",
        rf"/meshes/{mesh}/(extras|extras/targetNames|extras/targetNames/\d+|weights(/\d+)?)",
        rf"/nodes/{index}/(extras|extras/wrinkle|weights/\d+)",
        r"/animations/\d+/channels/\d+/sampler",
        # Images of a .gltf go into the .glb.
        r"/images/\d+/(uri|bufferView|mimeType)",
    ]
    cloned = before.json["nodes"][index]["mesh"] != mesh
    if cloned:
        assert mesh == len(before.json["meshes"]), "the clone comes last"
        assert after.json["meshes"][:mesh] == before.json["meshes"]
        allowed += [rf"/meshes/{mesh}", rf"/nodes/{index}/mesh"]
    free = set(touched(before, node, mesh=not cloned))
    used = {view for each in before.json["accessors"] for view in views_of(each)}
    views = {view for each in free for view in views_of(before.json["accessors"][each])}
    for path in differences(before.json, after.json):
        if match := re.match(r"/accessors/(\d+)(/|$)", path):
            assert int(match[1]) in free or int(match[1]) >= len(before.json["accessors"]), path
        elif (match := re.match(r"/bufferViews/(\d+)(/\w+)?$", path)) and match[2] not in ("/byteOffset", "/buffer"):
            assert int(match[1]) in views or int(match[1]) >= len(before.json["bufferViews"]), path
        else:
            assert path in samplers | widened or any(re.fullmatch(each, path) for each in allowed), path
    others = [k for k in range(len(before.json["accessors"])) if k not in free]
    for k in others:
        assert after.json["accessors"][k] == before.json["accessors"][k]
        assert after.stored(k).tobytes() == before.stored(k).tobytes(), k
    for k in set(range(len(before.json["bufferViews"]))) - used:
        assert after.view_bytes(k) == before.view_bytes(k), k
    for k, old in enumerate(before.json.get("nodes", [])):
        assert after.json["nodes"][k].get("children") == old.get("children")


def views_of(accessor: Json) -> Iterator[int]:
    sparse = accessor.get("sparse", {})
    for each in (accessor, sparse.get("indices", {}), sparse.get("values", {})):
        if "bufferView" in each:
            yield each["bufferView"]


def values(asset: Asset, index: int) -> Array:
    """(count, components) of a float accessor of an asset under construction."""
    accessor = asset.gltf["accessors"][index]
    view = asset.gltf["bufferViews"][accessor["bufferView"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    dtype = next(name for name, number in COMPONENTS.items() if number == accessor["componentType"])
    size = np.dtype(dtype).itemsize
    start, stride = view["byteOffset"] + accessor.get("byteOffset", 0), view.get("byteStride", size * width)
    return np.ndarray((accessor["count"], width), f"<{dtype}", bytes(asset.data), start, (stride, size)).copy()


def primitives_of(asset: Asset) -> list[Json]:
    found: list[Json] = asset.gltf["meshes"][0]["primitives"]
    return found


def vertex_count(asset: Asset, primitive: Json) -> int:
    count: int = asset.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
    return count


# Primitives


@pytest.mark.quick(1, 3)
@pytest.mark.parametrize(
    "options",
    [
        {"primitives": 3, "indices": "u1", "rings": 30, "sides": 6},
        {"primitives": 3, "indices": "u2", "normals": False},
        {"primitives": 2, "indices": "u4", "uvs": False},
        {"indices": None, "seam": False},
        {"mode": "strip", "rings": 13},
        {"mode": "strip", "rings": 13, "indices": None, "primitives": 2},
        {"mode": "fan", "rings": 13},
        {"mode": "fan", "rings": 13, "indices": None},
        {"interleave": True, "tangents": True, "colors": True, "primitives": 2},
        {"sparse": "base"},
        {"sparse": "zeros", "primitives": 2},
        {"influences": 8, "joints": 6},
        {"weight_dtype": "u1"},
        {"weight_dtype": "u2", "joints": 4},
        {"inverse_binds": False},
        {"morphs": 3, "morph_normals": True, "weights_at": "both", "morph_clip": "LINEAR"},
        {"morphs": 2, "weights_at": "mesh", "morph_clip": "CUBICSPLINE", "interpolation": "CUBICSPLINE"},
        {"morphs": 2, "weights_at": "node", "morph_clip": "STEP", "interpolation": "STEP", "primitives": 2},
        {"skinned": False, "clip": None, "morphs": 2, "morph_clip": "LINEAR"},
        {"morphs": 2, "weights_at": "both"},
        {"root": {"scale": [3.0, 3.0, 3.0], "rotation": [0.5, 0.5, 0.5, 0.5], "translation": [0.0, 0.0, 0.0]}},
    ],
    ids=lambda options: "-".join(f"{key}={value}" for key, value in options.items())[:60],
)
def test_forms_of_a_limb(options: Json) -> None:
    asset = limb_asset(**{"rings": 13, **options})
    tools = [TOOL]
    if "root" in options:  # x is drawn along y, y along z, three times as large
        tools = [tool(bumps=3, origin=[0.0, -1.2, 3 * RADIUS], target=[0.0, 1.2, 3 * RADIUS], width=0.9)]
    before, after = check(asset, *tools)
    assert sum(counts(after, "limb")) > sum(counts(before, "limb")), "nothing was refined"


def materials(asset: Asset) -> None:
    """A material for each primitive, and a texture on one."""
    for number, primitive in enumerate(primitives_of(asset)):
        factor = [0.1 * number, 0.2, 0.3, 1.0]
        primitive["material"] = asset.append("materials", {"pbrMetallicRoughness": {"baseColorFactor": factor}})


def loose_points_and_lines(asset: Asset) -> None:
    """Modes 0 to 3 beside triangles, with indices and without, on the limb's own vertices and on others."""
    (first,) = primitives_of(asset)
    for mode in (0, 1, 2, 3):
        extra: Json = {"attributes": dict(first["attributes"]), "mode": mode, "extras": {"mode": mode}}
        if "targets" in first:
            extra["targets"] = [dict(target) for target in first["targets"]]
        if mode % 2:
            extra["indices"] = asset.accessor(np.arange(10), "u2", target=ELEMENT_ARRAY_BUFFER)
        primitives_of(asset).append(extra)


def many_attributes(asset: Asset) -> None:
    """Every kind of COLOR_n, TEXCOORD_n and application attribute, those without a view and interleaved ones too."""
    rng = np.random.default_rng(7)
    for primitive in primitives_of(asset):
        count, attributes = vertex_count(asset, primitive), primitive["attributes"]
        for number, (dtype, width) in enumerate([("u1", 3), ("u1", 4), ("u2", 3), ("u2", 4), ("f4", 3), ("f4", 4)]):
            random = rng.uniform(size=(count, width)) * (1 if dtype == "f4" else np.iinfo(dtype).max)
            normalized = dtype != "f4"
            attributes[f"COLOR_{number}"] = asset.accessor(random, dtype, normalized=normalized, target=ARRAY_BUFFER)
        for number, dtype in enumerate(["u1", "u2", "f4"], 1):
            random = rng.uniform(size=(count, 2)) * (1 if dtype == "f4" else np.iinfo(dtype).max)
            normalized = dtype != "f4"
            attributes[f"TEXCOORD_{number}"] = asset.accessor(random, dtype, normalized=normalized, target=ARRAY_BUFFER)
        attributes["TEXCOORD_4"] = asset.append("accessors", {"componentType": 5126, "count": count, "type": "VEC2"})
        attributes["_HEAT"] = asset.accessor(rng.uniform(size=count), target=ARRAY_BUFFER)
        attributes["_FLOW"] = asset.accessor(rng.uniform(size=(count, 3)), target=ARRAY_BUFFER)
        attributes["_ID"] = asset.accessor(rng.integers(0, 9, count), "u1", target=ARRAY_BUFFER)
        attributes["_PAIR"] = asset.accessor(rng.integers(-99, 99, (count, 2)), "i2", target=ARRAY_BUFFER)
        attributes["_SIGN"] = asset.accessor(
            rng.integers(-127, 127, (count, 4)), "i1", normalized=True, target=ARRAY_BUFFER
        )
        numbers = asset.interleaved((rng.uniform(size=count), "f4", False), (rng.integers(0, 9, count), "u2", False))
        attributes |= dict(zip(("_LEFT", "_RIGHT"), numbers, strict=True))


def short_joints(asset: Asset) -> None:
    for primitive in primitives_of(asset):
        joints = values(asset, primitive["attributes"]["JOINTS_0"])
        primitive["attributes"]["JOINTS_0"] = asset.accessor(joints, "u2", target=ARRAY_BUFFER)


def weights_that_do_not_add_up(asset: Asset) -> None:
    for primitive in primitives_of(asset):
        weights = values(asset, primitive["attributes"]["WEIGHTS_0"])
        scaled = weights * np.linspace(0.3, 4.0, len(weights))[:, None]
        primitive["attributes"]["WEIGHTS_0"] = asset.accessor(scaled, target=ARRAY_BUFFER)


def vertices_without_weight(asset: Asset) -> None:
    """The far end of the limb, both sides of its seam."""
    for primitive in primitives_of(asset):
        weights = values(asset, primitive["attributes"]["WEIGHTS_0"])
        positions = values(asset, primitive["attributes"]["POSITION"])
        weights[positions[:, 0] < -0.8 * LENGTH / 2] = 0.0
        primitive["attributes"]["WEIGHTS_0"] = asset.accessor(weights, target=ARRAY_BUFFER)


def eight_influences(asset: Asset) -> None:
    """Every vertex follows all six joints a little, and the nearest ones most."""
    for primitive in primitives_of(asset):
        attributes = primitive["attributes"]
        xs = values(asset, attributes["POSITION"])[:, 0].astype(np.float64)
        weights = np.exp(-(((xs[:, None] - np.linspace(-1, 1, 6)) / 0.5) ** 2)) + 0.01
        order = np.argsort(-weights, axis=1, kind="stable")
        weights = np.take_along_axis(weights, order, 1) / weights.sum(axis=1, keepdims=True)
        for number in (0, 1):
            chosen = slice(4 * number, 4 * number + 4)
            pad = ((0, 0), (0, 4 - order[:, chosen].shape[1]))
            attributes[f"JOINTS_{number}"] = asset.accessor(np.pad(order[:, chosen], pad), "u1", target=ARRAY_BUFFER)
            attributes[f"WEIGHTS_{number}"] = asset.accessor(np.pad(weights[:, chosen], pad), target=ARRAY_BUFFER)


def quantized(asset: Asset) -> None:
    """KHR_mesh_quantization, as gltfpack writes it: int16 positions, int8 normals and tangents, uint16 UVs.

    The inverse binds of a skin take positions to size, else the node's scale does.
    """
    scale = LENGTH / 2 / 32767
    for primitive in primitives_of(asset):
        attributes = primitive["attributes"]
        for name in ("POSITION", "NORMAL", "TEXCOORD_0"):
            old = values(asset, attributes[name]).astype(np.float64)
            if name == "POSITION":
                attributes[name] = asset.accessor(np.rint(old / scale), "i2", bounds=True, target=ARRAY_BUFFER)
            elif name == "NORMAL":
                attributes[name] = asset.accessor(np.rint(old * 127), "i1", normalized=True, target=ARRAY_BUFFER)
            else:
                attributes[name] = asset.accessor(np.rint(old * 999), "u2", target=ARRAY_BUFFER)
        for target in primitive.get("targets", []):
            for name, index in target.items():
                old = values(asset, index).astype(np.float64)
                kind, unit = ("i2", scale) if name == "POSITION" else ("i1", 1 / 127)
                target[name] = asset.accessor(
                    np.rint(old / unit), kind, normalized=name == "NORMAL", bounds=name == "POSITION",
                    target=ARRAY_BUFFER,
                )  # fmt: skip
    if "skins" in asset.gltf:
        (skin,) = asset.gltf["skins"]
        inverse = values(asset, skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        inverse = inverse @ np.diag([scale, scale, scale, 1.0])
        skin["inverseBindMatrices"] = asset.accessor(inverse.transpose(0, 2, 1).reshape(-1, 16))
    else:
        asset.gltf["nodes"][0]["scale"] = [scale] * 3
    for key in ("extensionsUsed", "extensionsRequired"):
        asset.gltf[key] = ["KHR_mesh_quantization"]


def wide_normalized_positions(asset: Asset) -> None:
    """Normalised int16 positions: fractions of the node's scale."""
    for primitive in primitives_of(asset):
        old = values(asset, primitive["attributes"]["POSITION"])
        primitive["attributes"]["POSITION"] = asset.accessor(
            np.rint(old * 32767), "i2", normalized=True, bounds=True, target=ARRAY_BUFFER
        )
    for key in ("extensionsUsed", "extensionsRequired"):
        asset.gltf[key] = ["KHR_mesh_quantization"]


MORPHED: Json = {"skinned": False, "clip": None, "morphs": 2, "morph_normals": True, "morph_clip": "LINEAR"}


@pytest.mark.quick(1, 3)
@pytest.mark.parametrize(
    ("change", "options", "known"),
    [
        (materials, {"primitives": 3}, frozenset()),
        (loose_points_and_lines, {}, frozenset()),
        (loose_points_and_lines, {"morphs": 1, "skinned": False, "morph_clip": "LINEAR", "clip": None}, frozenset()),
        (many_attributes, {"primitives": 2}, frozenset()),
        (short_joints, {}, frozenset()),
        (weights_that_do_not_add_up, {}, KNOWN),
        (vertices_without_weight, {}, KNOWN),
        (eight_influences, {"joints": 6}, KNOWN),
        (quantized, {}, frozenset()),
        (quantized, MORPHED, frozenset()),
        (wide_normalized_positions, {}, frozenset()),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_forms_of_vertices(change: Change, options: Json, known: frozenset[str]) -> None:
    asset = limb_asset(**{"rings": 13, **options})
    change(asset)
    before, after = check(asset, known=known)
    assert sum(counts(after, "limb")) > sum(counts(before, "limb")), "nothing was refined"
    for old, new in zip(before.mesh("limb")["primitives"], after.mesh("limb")["primitives"], strict=True):
        assert list(old["attributes"]) == list(new["attributes"])
        assert old.get("material") == new.get("material")
        assert old.get("extras") == new.get("extras")
        for name, index in old["attributes"].items():
            was, now = before.stored(index), after.stored(new["attributes"][name])
            if was.dtype == now.dtype:
                assert now[: len(was)].tobytes() == was.tobytes(), name
            else:
                rounded = before.array(index).astype(np.float32)
                assert np.array_equal(rounded, after.array(new["attributes"][name])[: len(was)]), name


def test_points_and_lines_are_left_alone() -> None:
    asset = limb_asset(rings=13)
    loose_points_and_lines(asset)
    before, after = check(asset)
    pairs = zip(before.mesh("limb")["primitives"], after.mesh("limb")["primitives"], strict=True)
    for number, (old, new) in enumerate(pairs):
        if number:
            assert new["mode"] == old["mode"]
            assert new["attributes"] == old["attributes"]
            assert new.get("indices") == old.get("indices")
            assert len(new["targets"]) == len(after.mesh("limb")["primitives"][0]["targets"])


@pytest.mark.slow
def test_strips_and_fans_stay_where_nothing_is_refined() -> None:
    for mode in ("strip", "fan"):
        before, after = check(limb_asset(rings=13, mode=mode))
        for old, new in zip(before.mesh("limb")["primitives"], after.mesh("limb")["primitives"], strict=True):
            same = before.stored(old["indices"]).tobytes() == after.stored(new["indices"]).tobytes()
            assert new.get("mode", 4) == (old["mode"] if same else 4)


# Skins


def under_the_root(asset: Asset) -> None:
    """The skinned node is a child of a node that moves, which does not count (the validator warns)."""
    nodes = asset.gltf["nodes"]
    nodes[-1]["children"].append(0)
    asset.gltf["scenes"][0]["nodes"] = [len(nodes) - 1]


def second_limb(asset: Asset) -> None:
    """Another node shows another mesh with another skin, over the same accessors and joints, further off."""
    asset.append("meshes", json.loads(json.dumps(asset.gltf["meshes"][0])))
    (skin,) = asset.gltf["skins"]
    inverse = values(asset, skin["inverseBindMatrices"]).copy()
    inverse[:, 14] += 5.0
    asset.append("skins", {**skin, "inverseBindMatrices": asset.accessor(inverse)})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "other", "mesh": 1, "skin": 1}))


def statue(asset: Asset) -> None:
    """Two nodes more show the same mesh: one with a skin of its own, one without."""
    (skin,) = asset.gltf["skins"]
    inverse = values(asset, skin["inverseBindMatrices"]).copy()
    inverse[:, 14] += 5.0
    asset.append("skins", {**skin, "inverseBindMatrices": asset.accessor(inverse)})
    for more in ({"name": "further", "skin": 1}, {"name": "stone", "translation": [0.0, 0.0, -5.0]}):
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"mesh": 0, **more}))


def vanishing_joint(asset: Asset) -> None:
    """The far joint has no size, and the near one loses its size at the end of the clip."""
    asset.gltf["nodes"][4]["scale"] = [0.0, 0.0, 0.0]
    asset.channel(asset.gltf["animations"][0], 1, "scale", [0.0, 1.9, 2.0], [[1, 1, 1], [1, 1, 1], [0, 0, 0]])


def flat_joint(asset: Asset) -> None:
    """The far joint is flat: its matrix is singular, but not zero."""
    asset.gltf["nodes"][4]["scale"] = [1.0, 0.0, 1.0]


AROUND: Json = {"translation": [1.0, 2.0, 3.0], "scale": [2.0, 2.0, 2.0]}


@pytest.mark.quick(1, 3)
@pytest.mark.parametrize(
    ("change", "options", "keys"),
    [
        (under_the_root, {"root": AROUND}, {"origin": [0.2, 2.5, 3.0], "target": [1.8, 2.5, 3.0], "width": 0.6}),
        (second_limb, {}, {"node": "limb"}),
        (statue, {}, {"node": "limb"}),
        (statue, {"morphs": 1, "morph_clip": "LINEAR", "weights_at": "mesh"}, {"node": "limb"}),
        (None, {"root": {"scale": [-1.0, 1.0, 1.0]}}, {}),
        (
            None,
            {"root": {"scale": [2.0, 1.0, 0.5]}},
            {"origin": [-0.8, RADIUS, 0.0], "target": [0.8, RADIUS, 0.0], "width": 0.2},
        ),
        (
            None,
            {"root": {"matrix": [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, -2.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]}},
            {"origin": [1.0, 0.2, 1.5], "target": [1.0, 1.8, 1.5], "width": 0.6},
        ),
        (vanishing_joint, {"joints": 4}, {}),
        (flat_joint, {"joints": 4}, {}),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_forms_of_skins(change: Change | None, options: Json, keys: Json) -> None:
    asset = limb_asset(**{"rings": 13, **options})
    if change is not None:
        change(asset)
    before, after = check(asset, tool(bumps=3, **keys))
    assert sum(counts(after, "limb")) > sum(counts(before, "limb")), "nothing was refined"


@pytest.mark.slow
def test_only_the_named_node_of_a_shared_mesh_changes() -> None:
    asset = limb_asset(rings=13)
    statue(asset)
    before, after = check(asset, tool(bumps=3, node="further", origin=[-0.4, RADIUS, 5.0], target=[0.4, RADIUS, 5.0]),
                          node="further")  # fmt: skip
    times = np.linspace(0, 2, 9)
    for name in ("limb", "stone"):
        assert after.json["nodes"][after.node(name)]["mesh"] == 0
        assert np.array_equal(before.pose(name, "fold", times), after.pose(name, "fold", times))


def halves(asset: Asset) -> None:
    """The limb as two meshes, a head and a neck, which meet in a ring of vertices."""
    first, second = primitives_of(asset)
    asset.gltf["meshes"][0]["primitives"] = [first]
    node = asset.append("nodes", {"name": "neck", "mesh": asset.append("meshes", {"primitives": [second]}), "skin": 0})
    asset.gltf["scenes"][0]["nodes"].append(node)


@pytest.mark.quick(1)
@pytest.mark.parametrize("names", [["limb"], ["neck"], ["limb", "neck"]], ids="-".join)
def test_no_gap_opens_between_meshes_that_touch(names: list[str]) -> None:
    """What touched touches at all times, although tools run right up to the border from either side, and over it."""
    asset = limb_asset(rings=13, primitives=2)
    halves(asset)
    ends = {"limb": [[-0.7, RADIUS, 0.0], [0.0, RADIUS, 0.0]], "neck": [[0.0, RADIUS, 0.0], [0.7, RADIUS, 0.0]]}
    path = place(asset)
    tools = [
        tool(name=name, node=name, bumps=3, gap=0, origin=ends[name][0], target=ends[name][1], width=0.5)
        for name in names
    ]
    out = bake(path, *tools)
    assert_valid(out)
    before, after = Gltf(path), Gltf(out)
    times = np.linspace(0.0, 2.0, 41)
    head, neck = (after.attribute(name, "POSITION") for name in ("limb", "neck"))
    on_border = [np.flatnonzero(before.attribute(name, "POSITION")[:, 0] == 0) for name in ("limb", "neck")]
    assert len(on_border[0]) == 17
    assert np.flatnonzero(head[:, 0] == 0).tolist() == on_border[0].tolist(), "the border was split on one side alone"
    assert np.flatnonzero(neck[:, 0] == 0).tolist() == on_border[1].tolist(), "the border was split on one side alone"
    shown = [after.pose(name, "fold", times)[:, rows] for name, rows in zip(("limb", "neck"), on_border, strict=True)]
    assert np.abs(shown[0] - shown[1]).max() < 1e-6
    for name in names:
        assert moved_vertices(after, name).any()


# Animation


def normalized_rotations(asset: Asset) -> None:
    """Rotations as normalised int16 and int8."""
    for number, sampler in enumerate(asset.gltf["animations"][0]["samplers"]):
        kind = ("i2", "i1")[number % 2]
        turns = np.rint(values(asset, sampler["output"]) * np.iinfo(kind).max)
        sampler["output"] = asset.accessor(turns, kind, normalized=True)


def one_key(asset: Asset) -> None:
    """A translation with a single key, which holds."""
    asset.channel(asset.gltf["animations"][0], 1, "translation", [0.7], [[-1.0, 0.5, 0.0]])


def more_clips(asset: Asset) -> None:
    """A longer clip, a shorter one and one of a single key on the same joints; one that moves nothing of the limb."""
    half = np.radians(70.0) / 2
    turn = [[0, 0, 0, 1], [0, 0, np.sin(half), np.cos(half)], [0, 0, 0, 1]]
    for name, end, kind in (("long", 7.0, "LINEAR"), ("short", 0.25, "STEP")):
        clip: Json = {"name": name}
        asset.channel(clip, 2, "rotation", [0.0, end / 2, end], turn, "STEP" if kind == "STEP" else "LINEAR")
        asset.append("animations", clip)
    still: Json = {"name": "still"}
    asset.channel(still, 2, "rotation", [0.5], [turn[1]])
    asset.append("animations", still)
    lamp = asset.append("nodes", {"name": "lamp"})
    asset.gltf["scenes"][0]["nodes"].append(lamp)
    away: Json = {"name": "away"}
    asset.channel(away, lamp, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    asset.append("animations", away)


def late_start(asset: Asset) -> None:
    """Key times that begin at 3 s."""
    for sampler in asset.gltf["animations"][0]["samplers"]:
        sampler["input"] = asset.accessor(values(asset, sampler["input"])[:, 0] + 3.0, bounds=True)


def foreign_channels(asset: Asset) -> None:
    """Channels without a node, of an extension and of a path that nobody knows; a clip of nothing else."""
    asset.append("materials", {"name": "shiny"})
    fold = asset.gltf["animations"][0]
    pointer = {"KHR_animation_pointer": {"pointer": "/materials/0/pbrMetallicRoughness/roughnessFactor"}}
    asset.channel(fold, 0, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    del fold["channels"][-1]["target"]["node"]
    lone: Json = {"name": "lone"}
    for clip in (fold, lone):
        asset.channel(clip, 0, "weights", [0.0, 1.0], [0.2, 0.8])
        clip["channels"][-1]["target"] = {"path": "pointer", "extensions": pointer}
    asset.append("animations", lone)
    asset.gltf["extensionsUsed"] = ["KHR_animation_pointer"]


@pytest.mark.quick(1, 4)
@pytest.mark.parametrize(
    ("change", "options"),
    [
        (None, {"interpolation": "STEP"}),
        (None, {"interpolation": "CUBICSPLINE"}),
        (normalized_rotations, {"joints": 3}),
        (one_key, {}),
        (more_clips, {}),
        (more_clips, {"morphs": 2, "morph_clip": "CUBICSPLINE", "weights_at": "both"}),
        (late_start, {}),
        (late_start, {"interpolation": "STEP", "morphs": 1, "morph_clip": "STEP"}),
        (foreign_channels, {}),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_forms_of_animation(change: Change | None, options: Json) -> None:
    asset = limb_asset(**{"rings": 13, **options})
    if change is not None:
        change(asset)
    before, after = check(asset)
    for old, new in zip(before.json["animations"], after.json["animations"], strict=True):
        kept = new["channels"][: len(old["channels"])]
        assert [{**c, "sampler": 0} for c in kept] == [{**c, "sampler": 0} for c in old["channels"]]
        assert len(new["channels"]) <= len(old["channels"]) + 1
    if change is more_clips:
        bent = after.sampler("still", 0, "weights")
        assert bent is not None
        assert len(after.array(bent["input"])) == 1
        if "morphs" not in options:
            assert after.sampler("away", 0, "weights") is None
    if change is foreign_channels:
        assert after.json["animations"][1] == before.json["animations"][1]


# Documents


@pytest.mark.quick(1)
@pytest.mark.parametrize("options", [{}, {"morphs": 2, "weights_at": "both", "morph_clip": "LINEAR", "primitives": 2}])
def test_what_wrinkles_do_not_concern_is_kept_to_the_letter(options: Json) -> None:
    asset = limb_asset(rings=13, **options)
    crowd(asset)
    before, after = check(asset)
    keys = list(before.json)
    assert [key for key in after.json if key in keys] == keys
    for kind, old in before.json.items():
        if kind not in ("accessors", "bufferViews", "buffers", "meshes", "nodes", "animations"):
            assert json.dumps(after.json[kind]) == json.dumps(old), kind
    for index, old in enumerate(before.json["nodes"][1:], 1):
        assert json.dumps(after.json["nodes"][index]) == json.dumps(old)
    changed = dict(after.json["nodes"][0])
    extras = {key: value for key, value in changed.pop("extras").items() if key != "wrinkle"}
    assert json.dumps(extras) == json.dumps(before.json["nodes"][0]["extras"])
    assert changed.keys() == before.json["nodes"][0].keys() - {"extras"}
    assert json.dumps(after.json["meshes"][1]) == json.dumps(before.json["meshes"][1])


# Buffers and images


def image_bytes(file: Gltf, index: int) -> bytes:
    image = file.json["images"][index]
    if "bufferView" in image:
        return file.view_bytes(image["bufferView"])
    if image["uri"].startswith("data:"):
        return b64decode(image["uri"].partition(",")[2])
    assert not os.path.isabs(image["uri"])
    return (file.path.parent / unquote(image["uri"])).read_bytes()


@pytest.mark.quick(1)
@pytest.mark.parametrize("out", ["out.glb", "out.gltf", "below/out.glb", "below/out.gltf", "../beside/out.gltf"])
def test_resources_of_every_kind(tmp_path: Path, out: str) -> None:
    (tmp_path / "in").mkdir()
    path = scattered(tmp_path / "in")
    target = bake(path, out=out)
    before, after = Gltf(path), Gltf(target)
    assert_right(before, after, "limb")
    assert [image_bytes(after, k) for k in range(4)] == [image_bytes(before, k) for k in range(4)]
    for uri in (buffer.get("uri") for buffer in after.json["buffers"]):
        assert (uri is None) == out.endswith(".glb")
    if out.endswith(".glb"):
        assert len(after.json["buffers"]) == 1
    free = set(touched(before, "limb", mesh=True))
    for k in set(range(len(before.json["accessors"]))) - free:
        assert after.stored(k).tobytes() == before.stored(k).tobytes()


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize("form", ["glb", "file", "data", "percent", "folder"])
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_containers(tmp_path: Path, form: Any, ending: str) -> None:
    asset = limb_asset(rings=13)
    path = asset.write(
        tmp_path / ("a.glb" if form == "glb" else "a.gltf"), **({} if form == "glb" else {"buffer": form})
    )
    target = bake(path, out=f"out{ending}")
    assert_valid(path, target)
    assert_right(Gltf(path), Gltf(target), "limb")
    # The same whatever it was read from and written to.
    other = Gltf(bake(place(limb_asset(rings=13))))
    assert np.array_equal(Gltf(target).pose("limb", "fold", [0.7]), other.pose("limb", "fold", [0.7]))


@pytest.mark.quick(2)
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("way", ["dots", "absolute", "link", "linked folder"])
def test_what_lies_outside_is_read_only_where_allowed(tmp_path: Path, way: str, ending: str) -> None:
    inside, outside = tmp_path / "in", tmp_path / "textures"
    inside.mkdir()
    outside.mkdir()
    path = limb_asset(rings=13).write(inside / "a.gltf")
    (inside / "a.bin").rename(outside / "a.bin")
    (outside / "skin.png").write_bytes(PNG)
    (inside / "linked").symlink_to(outside)
    (inside / "link.bin").symlink_to(outside / "a.bin")
    (inside / "link.png").symlink_to(outside / "skin.png")
    roots = {"dots": "../textures/", "absolute": f"{outside}/", "linked folder": "linked/"}
    data, picture = ("link.bin", "link.png") if way == "link" else (f"{roots[way]}a.bin", f"{roots[way]}skin.png")
    gltf = json.loads(path.read_text())
    gltf["buffers"][0]["uri"], gltf["images"] = data, [{"uri": picture}]
    path.write_text(json.dumps(gltf))
    with pytest.raises(AssetError, match=r"#/buffers/0: .* is not a file below .* --allow-external"):
        bake(path, out=f"out/b{ending}")
    assert os.listdir(inside / "out") == []
    target = bake(path, out=f"out/b{ending}", allow_external=True)
    (outside / "a.bin").unlink()
    (outside / "skin.png").unlink()
    after = Gltf(target)
    assert len(after.pose("limb", "fold", [0.7])[0])
    assert image_bytes(after, 0) == PNG
    for uri in (each["uri"] for kind in ("buffers", "images") for each in after.json[kind] if "uri" in each):
        assert not uri.startswith(("..", "/")), "leads out of the new folder"


@pytest.mark.slow
@pytest.mark.long
def test_the_command_line_allows_it_too(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    path = limb_asset(rings=13).write(tmp_path / "in" / "a.gltf")
    (tmp_path / "in" / "a.bin").rename(tmp_path / "a.bin")
    path.write_text(path.read_text().replace('"a.bin"', '"../a.bin"'))
    out, tools = tmp_path / "out.glb", write_tools(tmp_path / "tools.yaml", TOOL)
    command = [sys.executable, "-c", "from wrinklecli.cli import main; main()", "bake", path, tools, "-o", out, "-q"]
    codes = [
        subprocess.run([*command, *more], capture_output=True, check=False).returncode
        for more in ([], ["--allow-external"])
    ]
    assert codes == [1, 0]
    assert out.exists()


def test_other_schemes_are_never_followed(tmp_path: Path) -> None:
    for uri in ("http://localhost/a.bin", "file:///etc/hostname", "a%00.bin"):
        path = limb_asset(rings=5).write(tmp_path / "a.gltf")
        gltf = json.loads(path.read_text())
        gltf["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(gltf))
        with pytest.raises(AssetError, match="not a file below"):
            bake(path, allow_external=True)
