"""Assets and tools files that were damaged at random, always the same way for the same number, and a bake of them.

`python tests/kit/hostile.py FIRST COUNT` runs many and prints what failed.
"""

import base64
import json
import math
import random
import shutil
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from kit.asset import Asset, Json, pack_glb, read_glb
from kit.limb import RADIUS, limb_asset, limb_weights, tool
from wrinklecli import bake
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document

SECONDS = 10.0  # of processor time that a bake of a small file may take
_WAITING = 30.0  # times as long by the clock: other programs may run, but nothing may wait for ever
MEGABYTES = 1024.0  # that it may grow the process by
_LONGEST_LINE = 1000  # characters of a message
_PER_LINE = 500  # cases of `main`, for it to show that it goes on

_WORDS = ["SCALAR", "VEC3", "VEC4", "MAT4", "STEP", "LINEAR", "CUBICSPLINE", "translation", "rotation", "scale"]
_PATHS = ["weights", "POSITION", "NORMAL", "../x.bin", "/etc/passwd", "file:///etc/passwd", "http://localhost/x"]
_TEXTS = ["", "x", "\n\x1b[31mred\x07", "\ud800", "%2e%2e/%2e%2e/x", "a\0b", "limb.bin", ".", "data:,", "x" * 5000]
_URIS = ["data:application/octet-stream;base64,AAAA", "data:;base64,*", "limb.glb", "//host/x", "C:\\x", "joint_0"]
_SMALL = [-1, 0, 1, 2, 3, 4, 5, 7, 16, 255, 256, 5120, 5121, 5123, 5125, 5126]
_LARGE = [2**16, 2**20, 2**26, 2**26 + 1, 2**31, 2**32 - 1, 2**53, 2**63, 2**64, 10**400, -(2**31), -(10**30)]
_REALS = [0.5, -0.0, 1e-45, 1e-320, 1e-6, 1e6, 1e12, 1e30, 3.4e38, 3.5e38, 1e160, 1.7e308, -1e30, math.nan, math.inf]
_OTHERS = [None, True, False, [], {}, [0], [[]], {"a": 1}, [1e30] * 3, [0.0] * 4, [1e300] * 16, [0] * 1000, [{}] * 500]


@dataclass(frozen=True)
class Source:
    """A sound asset and tools file to damage: the asset's ending, its JSON and the bytes of its buffer."""

    suffix: str
    gltf: Json
    data: bytes
    tools: Json


@dataclass(frozen=True)
class Case:
    """A damaged asset and tools file, and how to bake them."""

    name: str
    asset: bytes
    tools: bytes
    suffix: str
    out: str
    options: Json


@cache
def corpus() -> list[Source]:
    """Small assets that between them have every feature that is read."""
    small = {"refinement": {"max_levels": 1}, "sampling": {"fps": 4}}
    limb = {"rings": 7, "sides": 6}
    two = [tool(), tool(name="other", strategy="both_ends", bumps=3, details=[0.2], attachment="patch")]
    morph = tool(strategy="origin", bumps=2, rest_length={"morph": "morph_0", "full": "120%"}, snap="vertex")
    keyed = tool(rest_length={"keys": {"fold": [[0, "100%"], [1, 1.2]]}}, profile="polyline", details=[0.2])
    marked = tool(origin={"marker": "joint_0"}, target={"marker": "joint_1"}, clips={"fold": 0.5}, max_height="none")
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
    return [*sources, _baked(sources[0]), *_large()]


def _large() -> list[Source]:
    """Assets and tools files with much of one thing: clips, tools, edges at a vertex, time, levels."""
    limb = {"rings": 7, "sides": 6}
    clips = limb_asset(**limb)
    animation = clips.gltf["animations"][0]
    clips.gltf["animations"] = [{**animation, "name": f"fold {k}"} for k in range(40)]
    crowd = [tool(name=f"t{k}", bumps=1 + k % 3, width=0.1 + 0.02 * k) for k in range(30)]
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
        paths = [Path(folder, name) for name in ("limb.glb", "tools.yaml", "out.glb")]
        paths[0].write_bytes(packed(source.gltf, source.data, source.suffix))
        paths[1].write_text(json.dumps(source.tools))
        bake(*paths)
        gltf, data = read_glb(paths[2].read_bytes())
    return Source(".glb", gltf, data[: gltf["buffers"][0]["byteLength"]], source.tools)


def make_case(number: int) -> Case:
    """The damaged files of a number: one to three faults in the bytes, JSON, data or tools."""
    chance = random.Random(number)
    # Those with much of something take longer.
    source = chance.choices(corpus(), [3] * (len(corpus()) - 5) + [1] * 5)[0]
    gltf, tools, data = (
        json.loads(json.dumps(source.gltf)),
        json.loads(json.dumps(source.tools)),
        bytearray(source.data),
    )
    names = []
    file_faults: list[Callable[[random.Random, bytearray], None]] = []
    tools_faults: list[Callable[[random.Random, bytearray], None]] = []
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        kind = chance.choices(
            ["json", "link", "number", "data", "asset bytes", "tools", "tools bytes"], [30, 15, 15, 20, 8, 10, 4]
        )[0]
        names.append(kind)
        match kind:
            case "json":
                _damage_json(chance, gltf)
            case "link":
                _damage_links(chance, gltf)
            case "number":
                _damage_numbers(chance, gltf)
            case "data":
                _damage_data(chance, gltf, data)
            case "asset bytes":
                file_faults.append(_damage_bytes)
            case "tools":
                _damage_json(chance, tools)
            case _:
                tools_faults.append(_damage_bytes)
    asset = bytearray(packed(gltf, bytes(data), source.suffix))
    text = bytearray(json.dumps(tools, ensure_ascii=chance.random() < 0.5).encode("utf-8", "replace"))
    for fault in file_faults:
        fault(chance, asset)
    for fault in tools_faults:
        fault(chance, text)
    options: Json = {"replace": True}  # of an asset without wrinkles there is nothing to replace
    if chance.random() < 0.2:
        options["mode"] = "frames"
    if chance.random() < 0.1:
        options["accessors"] = "dense"
    if chance.random() < 0.1:
        options["tracks"] = "none"
    if chance.random() < 0.05:
        options |= {"frames_dir": True, "frames_format": "obj"}
    if chance.random() < 0.1:
        options["details"] = True
    out = chance.choice(["out.glb", "out.glb", "out.gltf", "sub/out.gltf"])
    return Case(f"{number} ({', '.join(names)})", bytes(asset), bytes(text), source.suffix, out, options)


def packed(gltf: Any, data: bytes, suffix: str) -> bytes:
    """The bytes of an asset: a .gltf has its buffer in it, as a data URI."""
    if suffix == ".gltf":
        buffers = gltf.get("buffers") if isinstance(gltf, dict) else None
        if isinstance(buffers, list) and buffers and isinstance(buffers[0], dict):
            buffers[0].setdefault("uri", "data:application/gltf-buffer;base64," + base64.b64encode(data).decode())
        return json.dumps(gltf).encode()
    return pack_glb(json.dumps(gltf).encode(), data)


def _junk(chance: random.Random) -> Any:
    return chance.choice(chance.choice([_SMALL, _SMALL, _LARGE, _REALS, _WORDS, _PATHS, _TEXTS, _URIS, _OTHERS]))


def _place(chance: random.Random, root: Any, *, deep: bool = False) -> tuple[Any, Any]:
    """A container of the tree and a key of it."""
    at, key = root, chance.choice(list(root))
    while isinstance(at[key], dict | list) and at[key] and (deep or chance.random() < 0.8):
        at = at[key]
        key = chance.choice(list(at)) if isinstance(at, dict) else chance.randrange(len(at))
    return at, key


def _damage_json(chance: random.Random, root: Json) -> None:
    """Replace, delete, duplicate, insert or swap values anywhere."""
    if not root:
        return
    at, key = _place(chance, root)
    match chance.randrange(6):
        case 0 | 1:
            at[key] = _junk(chance)
        case 2:
            del at[key]
        case 3:
            other, other_key = _place(chance, root)
            at[key] = json.loads(json.dumps(other[other_key]))
        case 4 if isinstance(at, list):
            at.insert(key, json.loads(json.dumps(chance.choice(at))) if chance.random() < 0.5 else _junk(chance))
        case _:
            if isinstance(at, dict):
                at[chance.choice([*at, *_KEYS])] = _junk(chance)
            else:
                at[key:key] = [at[key]] * chance.choice([1, 2, 300])


_KEYS = [
    "matrix",
    "weights",
    "skin",
    "mesh",
    "children",
    "translation",
    "rotation",
    "scale",
    "sparse",
    "bufferView",
    "byteOffset",
    "byteStride",
    "normalized",
    "count",
    "uri",
    "extensions",
    "extras",
    "targets",
    "indices",
    "mode",
    "skeleton",
    "images",
    "extensionsRequired",
    "name",
    "camera",
    "targetNames",
    "width",
    "bumps",
    "gap",
    "details",
    "max_height",
    "rest_length",
    "strength",
    "attenuation",
    "snap",
    "mirror",
    "clips",
    "sampling",
    "fps",
    "rest",
    "up",
]


def _damage_links(chance: random.Random, gltf: Json) -> None:
    """Turn an index to something else, or bend the node graph, skin or channels."""
    nodes = gltf.get("nodes")
    nodes = nodes if isinstance(nodes, list) else []
    some = [each for each in nodes if isinstance(each, dict)]
    if some and chance.random() < 0.4:
        node = chance.choice(some)
        number = chance.randrange(len(nodes))
        match chance.randrange(6):
            case 0:
                node["children"] = [number]
            case 1:
                node["children"] = list(range(len(nodes)))
            case 2:
                node["skin"] = chance.choice(_SMALL)
            case 3:
                node["mesh"] = chance.choice([0, 0, 1])
            case 4:
                node[chance.choice(["translation", "scale"])] = [chance.choice(_REALS[:-2]) for _ in range(3)]
            case _:
                node["matrix"] = [chance.choice([0, 1, *_REALS[:-2]]) for _ in range(16)]
        return
    integers = [(at, key) for at, key in _values(gltf) if isinstance(at[key], int) and not isinstance(at[key], bool)]
    if integers:
        at, key = chance.choice(integers)
        at[key] = chance.randrange(12)


def _damage_numbers(chance: random.Random, gltf: Json) -> None:
    """Another number in the accessors, views, buffers, samplers: counts, offsets, lengths, types."""
    kind = chance.choice(["accessors", "accessors", "bufferViews", "buffers", "meshes", "skins", "animations", "nodes"])
    found = gltf.get(kind)
    if not isinstance(found, list) or not found:
        return
    item = chance.choice(found)
    numbers = [(at, key) for at, key in _values([item]) if isinstance(at[key], int | float)]
    if numbers:
        at, key = chance.choice(numbers)
        near = [at[key] - 1, at[key] + 1, at[key] * 2, at[key] // 2] if abs(at[key]) < math.inf else []
        at[key] = chance.choice([*near, chance.choice([*_SMALL, *_LARGE, *_REALS])])
    if kind == "accessors" and isinstance(item, dict) and chance.random() < 0.2:
        item.pop("bufferView", None)
        item["count"] = chance.choice([1, 49, 2**20, 2**24, 2**26, 2**32])


def _values(root: Any) -> Iterator[tuple[Any, Any]]:
    """Every container and key of a leaf."""
    for key, child in root.items() if isinstance(root, dict) else enumerate(root):
        if isinstance(child, dict | list):
            yield from _values(child)
        else:
            yield root, key


def _damage_data(chance: random.Random, gltf: Json, data: bytearray) -> None:
    """Numbers that are not, or are too large or small, in what an accessor shows; or any bytes."""
    found = gltf.get("bufferViews")
    views = [view for view in found if isinstance(view, dict)] if isinstance(found, list) else []
    if not views or not data:
        return
    view = chance.choice(views)
    start, length = view.get("byteOffset", 0), view.get("byteLength", 4)
    if not isinstance(start, int) or not isinstance(length, int) or not 0 <= start < len(data) or length < 4:
        return
    count = min(length, len(data) - start) // 4
    value = chance.choice([math.nan, math.inf, -math.inf, 1e30, -3e38, 1e-45, 1e-38, 0.0, -0.0, 1e10, 1e-10, 1e20, 2.0])
    for _ in range(chance.choice([1, 1, 3, count])):
        place = start + 4 * chance.randrange(max(count, 1))
        if place + 4 <= len(data):
            data[place : place + 4] = struct.pack("<f", value) if chance.random() < 0.8 else chance.randbytes(4)


def _damage_bytes(chance: random.Random, data: bytearray) -> None:
    """Cut, flip, overwrite, repeat or insert bytes."""
    if not data:
        return
    place = chance.randrange(len(data))
    head = min(place, chance.choice([12, 40, len(data)]))
    match chance.randrange(6):
        case 0:
            del data[place:]
        case 1:
            for _ in range(chance.choice([1, 2, 8])):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case 2:
            data[head : head + 4] = chance.choice([b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\1\0\0\0"])
        case 3:
            data[place:place] = data[head : head + 64]
        case 4:
            del data[place : place + chance.choice([1, 4, 64])]
        case _:
            data[place:place] = chance.choice(
                [b"[" * 3000, b"&a [*a, *a]", b"\0", b"1e999", b'"', b"\xff\xfe", b": ", b"- "]
            )


def run(case: Case, folder: Path) -> str:
    """Bake a case in an empty folder, and give the name of the error that it ended in, or `done`.

    Raises:
        AssertionError: It left what it should not, took too long or too much, or said it badly.
    """
    asset, tools, out = folder / f"limb{case.suffix}", folder / "tools.yaml", folder / case.out
    out.parent.mkdir(exist_ok=True)
    asset.write_bytes(case.asset)
    tools.write_bytes(case.tools)
    out.write_bytes(b"old")
    before = set(folder.rglob("*"))
    options = dict(case.options)
    if options.get("frames_dir"):
        options["frames_dir"] = folder / "frames"
    refused: WrinkleError | None = None
    with bounded():
        try:
            bake(asset, tools, out, **options)
        except WrinkleError as error:
            refused = error
    if refused is not None:
        left = {str(path) for path in set(folder.rglob("*")) - before}
        assert not left, f"left behind {left}"
        assert out.read_bytes() == b"old", "the old OUT has changed"
        assert refused.lines, "an error without a message"
        for line in refused.lines:
            assert line.strip(), "an empty message"
            assert len(line) <= _LONGEST_LINE, f"a message of {len(line)} characters: {line[:200]}"
            assert "\n" not in line, f"a message of several lines: {line!r}"
        return type(refused).__name__
    made = {path for path in set(folder.rglob("*")) - before if path.parent.name != "frames"}
    read_document(out)
    strangers = [str(path) for path in made if path.suffix != ".bin" and path.name != "frames"]
    assert not strangers, f"left behind {strangers}"
    return "done"


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


def main(first: int, count: int) -> None:
    warnings.simplefilter("error")
    tally: dict[str, int] = {}
    seen: dict[str, list[int]] = {}
    for number in range(first, first + count):
        folder = Path(mkdtemp(prefix="hostile-"))
        try:
            outcome = run(make_case(number), folder)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            outcome = "FAILED"
            frames = [f for f in traceback.extract_tb(error.__traceback__) if "wrinklecli" in f.filename]
            at = f"{Path(frames[-1].filename).name}:{frames[-1].lineno} {frames[-1].line}" if frames else ""
            key = f"{type(error).__name__}: {str(error)[:110]} @ {at}"
            if key not in seen:
                print(number, key, flush=True)
            seen.setdefault(key, []).append(number)
        finally:
            shutil.rmtree(folder)
        tally[outcome] = tally.get(outcome, 0) + 1
        if (number + 1 - first) % _PER_LINE == 0:
            print(f"{number + 1 - first} cases:", tally, flush=True)
    print(tally)
    for key, numbers in seen.items():
        print(len(numbers), numbers[:5], key)


if __name__ == "__main__":
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, 6 * 2**30))
    main(int(sys.argv[1]), int(sys.argv[2]))
