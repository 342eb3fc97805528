"""Small sound assets, with tools, that between them have every feature that is read, and bounds on time and memory."""

import base64
import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from kit.asset import Asset, Json, pack_glb, read_glb
from kit.bakes import baked
from kit.compressed import compressed_sample
from kit.limb import RADIUS, limb_asset, limb_weights, tool
from kit.samples import PALM
from kit.variants import crowd, rich

SECONDS = 10.0  # of processor time that a command on a small file may take
_WAITING = 30.0  # times as long by the clock: other programs may run, but nothing may wait for ever
MEGABYTES = 1024.0  # that it may grow the process by


@dataclass(frozen=True)
class Source:
    """A sound asset and tools file to damage: the asset's ending, its JSON and the bytes of its buffer."""

    suffix: str
    gltf: Json
    data: bytes
    tools: Json


SOURCES = 31  # in the corpus


@cache
def corpus() -> list[Source]:
    """Small assets that between them have every feature that is read."""
    small = {"refinement": {"max_levels": 1}, "sampling": {"fps": 4}}
    limb = {"rings": 7, "sides": 6}
    two = [tool(), tool(name="other", strategy="both_ends", bumps=3, details=[0.2], attachment="patch")]
    morph = tool(strategy="origin", bumps=2, rest_length={"morph": "morph_0", "full": "120%"}, snap="vertex")
    keyed = tool(rest_length={"keys": {"fold": [[0, "100%"], [1, 1.2]]}}, profile="polyline", details=[0.2])
    marked = tool(
        origin={"marker": "joint_0"},
        target={"marker": "joint_1"},
        clips={"fold": 0.5},
        max_height="none",
        optional=True,
    )
    mirrored = tool(name="crease.L", origin=[-0.8, 0.5, 0], target=[0.8, 0.5, 0], width=0.6, mirror="y")
    assets = [
        (".glb", {}, [tool()], {}),
        (".glb", {"morphs": 2, "morph_normals": True, "morph_clip": "CUBICSPLINE"}, [morph], {"rest": "bind"}),
        (".glb", {"sparse": "base", "morphs": 1, "morph_clip": "STEP", "weights_at": "node"}, [tool(bumps=2)], {}),
        (".gltf", {"mode": "strip", "weight_dtype": "u1", "interpolation": "CUBICSPLINE"}, [keyed], {}),
        (
            ".gltf",
            {"primitives": 2, "influences": 8, "joints": 3, "tangents": True, "colors": True},
            two,
            {"refinement": {"max_levels": 0}},
        ),
        (
            ".glb",
            {"sparse": "zeros", "interleave": True, "root": {"scale": [2, 2, 2]}},
            [mirrored],
            {},
        ),
        (".glb", {"skinned": False, "morphs": 1, "morph_clip": "LINEAR", "clip": None}, [tool(node="limb")], {}),
        (".gltf", {"inverse_binds": True, "clip": "grow", "seam": False}, [marked], {"up": "y"}),
        (".glb", {}, [tool(width="30%")], {"rest": {"clip": "fold", "time": 0.1}}),
    ]
    sources = []
    for suffix, options, tools, header in assets:
        asset = limb_asset(**limb, **options)
        asset.gltf["buffers"] = [{"byteLength": len(asset.data)}]
        sources.append(Source(suffix, asset.gltf, bytes(asset.data), {"version": 1, **small, **header, "tools": tools}))
    # In this order for good: kept cases name a source by its number.
    return [*sources, _baked(sources[0]), *_dressed(), *_large(), *_grown(), *_folded(), *_garment()]


def _dressed() -> list[Source]:
    """Assets with what a bake passes through: materials, cameras, unknown keys, instances; and compressed ones."""
    header: Json = {"version": 1, "refinement": {"max_levels": 1}, "sampling": {"fps": 4}}
    decorated, crowded, instanced = rich(), limb_asset(rings=7, sides=6), limb_asset(rings=7, sides=6)
    crowd(crowded)
    decorated.gltf["skins"][0]["skeleton"] = 1
    places = {"TRANSLATION": instanced.accessor(np.arange(9.0).reshape(3, 3))}
    mesh = instanced.gltf["meshes"][0]["primitives"][0]["attributes"]
    hat = {"primitives": [{"attributes": {"POSITION": mesh["POSITION"]}, "mode": 0}]}
    instanced.append("meshes", hat)
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    instanced.append("nodes", {"name": "hats", "mesh": 1, "extensions": extensions})
    instanced.gltf["scenes"][0]["nodes"].append(len(instanced.gltf["nodes"]) - 1)
    instanced.gltf |= {"extensionsUsed": list(extensions), "extensionsRequired": list(extensions)}
    sources = [
        Source(
            ".glb",
            {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]},
            bytes(asset.data),
            header | {"tools": [tool()]},
        )
        for asset in (decorated, crowded, instanced)
    ]
    for name in ("gltf_transform_draco", "gltfpack_cc", "gltfpack_cc_khr", "gltfpack_c_float"):
        gltf, data = read_glb(compressed_sample(name).read_bytes())
        sources.append(Source(".glb", gltf, data, header | {"tools": [PALM]}))
    return sources


def _large() -> list[Source]:
    """Assets and tools files with much of one thing: clips, tools, edges at a vertex, time, levels."""
    limb = {"rings": 7, "sides": 6}
    clips = limb_asset(**limb)
    animation = clips.gltf["animations"][0]
    clips.gltf["animations"] = [{**animation, "name": f"fold {k}"} for k in range(40)]
    materials = ("skin", "cloth", "leather", "none")
    crowd = [tool(name=f"t{k}", bumps=1 + k % 3, width=0.1 + 0.02 * k, material=materials[k % 4]) for k in range(30)]
    long = limb_asset(**limb, clip=None)
    times = np.arange(300) / 10.0
    angles = 0.4 * np.abs(np.sin(times))
    turns = np.stack([0 * times, 0 * times, np.sin(angles), np.cos(angles)], axis=1)
    animation = {"name": "long"}
    long.channel(animation, 2, "rotation", times, turns)
    long.append("animations", animation)
    cases: list[tuple[Asset, list[Json], Json]] = [
        (clips, [tool()], {"refinement": {"max_levels": 1}, "sampling": {"fps": 4}}),
        (limb_asset(**limb), crowd, {"refinement": {"max_levels": 1}, "sampling": {"fps": 4}}),
        (pole(300), [tool(width=1.0)], {"refinement": {"max_levels": 2}, "sampling": {"fps": 4}}),
        (long, [tool(attachment="patch")], {"refinement": {"max_levels": 1}}),
        (limb_asset(**limb), [tool(bumps=12)], {"refinement": {"max_levels": 8}}),
    ]
    return [
        Source(
            ".glb",
            {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]},
            bytes(asset.data),
            {"version": 1, **header, "tools": tools},
        )
        for asset, tools, header in cases
    ]


def _grown() -> list[Source]:
    """Tools along paths, irregular, with tissue that lags, on one mesh and on two; and what a bake writes of them."""
    header: Json = {"version": 1, "refinement": {"max_levels": 1}, "sampling": {"fps": 4}}
    bent = [[-0.5, RADIUS, 0.0], [0.0, RADIUS, 0.05], [0.5, RADIUS, 0.0]]
    lag = {"frequency": 3, "damping": 0.3}
    grown = {"bow": 0.5, "variation": 1, "branch": 1, "profile": "cloth"}
    path = {"name": "path", "path": bent, "width": 0.3, "bumps": 3, "strategy": "origin", "lag": lag, **grown}
    marked = [{"marker": "joint_0"}, [0.2, RADIUS, 0.05], [0.8, RADIUS, 0.0]]
    both = [
        {"name": "marked", "node": "limb", "path": marked, "width": 0.4, "snap": "vertex", "bow": -1},
        {"name": "side.L", "node": "limb", "path": bent[:2], "width": 0.3, "mirror": "x", "lag": "none", "seed": 7},
        {"name": "skin", "node": "limb", "origin": bent[0], "target": bent[2], "width": 0.5, "profile": "skin"},
    ]
    alone, two = limb_asset(rings=7, sides=6), limb_asset(rings=7, sides=6, morphs=1, morph_clip="LINEAR")
    crowd(two)
    sources = [
        Source(
            suffix,
            {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]},
            bytes(asset.data),
            {**header, "defaults": {"lag": {}, "variation": 0.5}, "tools": tools},
        )
        for suffix, asset, tools in ((".glb", alone, [path]), (".gltf", two, both))
    ]
    return [*sources, _baked(sources[0])]


def _folded() -> list[Source]:
    """Folds with contact: two that share vertices, one that closes, in clips of one moment, of triangles anywhere."""
    header: Json = {"version": 1, "refinement": {"max_levels": 0}, "sampling": {"fps": 4}}
    fold = tool(contact="resolve")
    two = [
        {**fold, "name": name, "origin": [x - 0.3, RADIUS, 0.0], "target": [x + 0.3, RADIUS, 0.0]}
        for name, x in (("near", -0.3), ("far", 0.3))
    ]
    limb = {"rings": 9, "sides": 6}
    still = limb_asset(**limb)
    animation: Json = {"name": "still"}
    still.channel(animation, 2, "rotation", [0.0], [[0.0, 0.0, 0.8, 0.6]])
    still.append("animations", animation)
    cloud = limb_asset(rings=7, sides=6)
    (primitive,) = cloud.gltf["meshes"][0]["primitives"]
    primitive["indices"] = cloud.accessor(np.random.default_rng(1).integers(0, 49, 90), "u2")
    cases: list[tuple[Asset, list[Json]]] = [
        (limb_asset(**limb, joints=3, angle=140.0), two),
        (limb_asset(**limb, angle=170.0), [fold]),
        (still, [fold]),
        (cloud, [fold]),
    ]
    return [
        Source(
            ".glb",
            {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]},
            bytes(asset.data),
            {**header, "tools": tools},
        )
        for asset, tools in cases
    ]


def _garment() -> list[Source]:
    """A sleeve with a field of wrinkles, and what a bake of it writes."""
    asset = limb_asset(rings=9, sides=8)
    tools = {
        "version": 1,
        "refinement": {"max_levels": 1},
        "sampling": {"fps": 4},
        "fields": [{"name": "sleeve", "wavelength": "30%", "strength": 0.9, "clips": {"fold": 0.5}}],
    }
    source = Source(".glb", {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]}, bytes(asset.data), tools)
    return [source, _baked(source)]


def pole(edges: int) -> Asset:
    """The limb's skeleton under a disc whose triangles all meet at one vertex."""
    asset = limb_asset(rings=3, sides=4)
    angles = np.linspace(0.0, 2 * np.pi, edges, endpoint=False)
    rim = np.stack([np.cos(angles), np.full(edges, RADIUS), -np.sin(angles)], axis=1)
    positions = np.concatenate([[[0.0, RADIUS, 0.0]], rim])
    around = 1 + np.arange(edges)
    triangles = np.stack([0 * around, around, 1 + around % edges], axis=1)
    weights = np.pad(limb_weights(positions[:, 0], 2), ((0, 0), (0, 2)))
    asset.gltf["meshes"][0]["primitives"] = [
        {
            "attributes": {
                "POSITION": asset.accessor(positions, bounds=True),
                "NORMAL": asset.accessor(np.tile([0.0, 1.0, 0.0], (len(positions), 1))),
                "JOINTS_0": asset.accessor(np.tile([0, 1, 0, 0], (len(positions), 1)), "u1"),
                "WEIGHTS_0": asset.accessor(weights),
            },
            "indices": asset.accessor(triangles.ravel(), "u4"),
        }
    ]
    return asset


def _baked(source: Source) -> Source:
    """What a bake of another source writes."""
    with TemporaryDirectory() as folder:
        asset = Path(folder, "limb.glb")
        asset.write_bytes(packed(source.gltf, source.data, source.suffix))
        gltf, data = read_glb(baked(asset, json.dumps(source.tools), "{}").read_bytes())
    return Source(".glb", gltf, data[: gltf["buffers"][0]["byteLength"]], source.tools)


def packed(gltf: Any, data: bytes, suffix: str) -> bytes:
    """The bytes of an asset: a .gltf has its buffer in it, as a data URI."""
    if suffix == ".gltf":
        buffers = gltf.get("buffers") if isinstance(gltf, dict) else None
        if isinstance(buffers, list) and buffers and isinstance(buffers[0], dict):
            buffers[0].setdefault("uri", "data:application/gltf-buffer;base64," + base64.b64encode(data).decode())
        return json.dumps(gltf).encode()
    return pack_glb(json.dumps(gltf).encode(), data)


@contextmanager
def bounded(*, seconds: float = SECONDS, megabytes: float = MEGABYTES) -> Iterator[None]:
    """Check the time and the growth of the process; after twice the time, stop.

    Time is the processor's, of this process: by the clock, a case would fail for what else the machine does. What
    waits instead of working is stopped too, after thirty times as long by the clock.
    """

    def late(*_: object) -> None:
        raise TimeoutError(f"still running after {2 * seconds:.0f} s")

    def waiting(*_: object) -> None:
        raise TimeoutError(f"still waiting after {_WAITING * seconds:.0f} s")

    earlier = {
        signal.SIGPROF: signal.signal(signal.SIGPROF, late),
        signal.SIGALRM: signal.signal(signal.SIGALRM, waiting),
    }
    signal.setitimer(signal.ITIMER_PROF, 2 * seconds)
    signal.setitimer(signal.ITIMER_REAL, _WAITING * seconds)
    began, size = time.process_time(), _megabytes(reset=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in earlier.items():
            signal.signal(number, handler)
        taken, grown = time.process_time() - began, _megabytes() - size
    assert taken < seconds, f"took {taken:.1f} s"
    assert grown < megabytes, f"grew by {grown:.0f} MB"


def _megabytes(*, reset: bool = False) -> float:
    """The most that the process has held, since the last reset where the system can tell."""
    if not Path("/proc/self/clear_refs").exists():
        return 0.0
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024.0
