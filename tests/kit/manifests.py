"""Manifests and caches of `wrinkle batch`, sound ones and such as somebody has damaged or forged."""

import csv
import hashlib
import io
import json
import os
import random
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from kit.asset import Json
from kit.damage import Edit, edit_bytes, edit_tree

NAMES = ("jobs.yaml", "jobs.csv", "jobs.jsonl")
MANIFEST: Json = {
    "version": 1,
    "defaults": {"tools": "tools.yaml", "split": True, "max_memory": "4GB"},
    "profiles": {"mobile": {"split": False, "max_levels": 1}},
    "jobs": [
        {
            "asset": "limb.*",
            "out": "sub/{stem}.gltf",
            "report": "sub/report.json",
            "timings": "sub/timings.json",
            "anim": "sound.glb",
        },
        {
            "asset": "sound.glb",
            "out": "sub/out.glb",
            "anims": ["limb.*", "body.glb"],
            "tracked": "sub/tracked",
            "max_error": "5%",
            "strict": True,
        },
    ],
}
# Paths that a manifest could name by mistake or on purpose. What is written there stays in the case's folder: a guard
# makes all else read-only.
# fmt: off
_PATHS = [
    "limb.glb", "limb.gltf", "sound.glb", "tools.yaml", "jobs.yaml", "jobs.jsonl", "sub", ".", "..", "../x.glb", "",
    " ", "cache", "cache/CACHEDIR.TAG", "cache/x.glb", "{stem}", "{folder}/{stem}.glb", "{none}.glb", "./limb.glb",
    "sub/../limb.glb", "linked/limb.glb", "out.glb", "sub/out.glb", "sub/limb.gltf", "sub/limb.bin", "*", "[",
    "**/*.glb", "*.glb", "x" * 300 + ".glb", "a\0b.glb", "\ud800.glb", "memory://x/limb.glb", "none://x.glb",
    "file://limb.glb", "http://127.0.0.1:1/x.glb", "zip://a.glb::limb.glb", "zip://a.glb::memory://x.zip",
    "/nowhere/x.glb", "~/x.glb",
]
_VALUES = [
    None, True, False, 0, -1, 1e308, 2, "1", "none", "1%", "-1%", "1e400", "4GB", "1MB", "99999TB", [], {}, [[]],
    [None], ["limb.glb"] * 3, {"asset": "limb.glb"}, [{"asset": "sound.glb", "out": "a.glb"}], "godot3", "frames",
    "x" * 5000, "\x1b[31m", 10**400,
]
_KEYS = [
    "asset", "tools", "out", "anims", "tracked", "lods", "mode", "anim", "clip", "tool", "fps", "max_error",
    "max_levels", "edges_per_interval", "max_vertices", "accessors", "tracks", "draft", "split", "morph_tangents",
    "engine", "frames_dir", "frames_format", "maps_dir", "report", "timings", "allow_external", "max_memory", "replace",
    "strict", "depfile", "version", "jobs", "defaults", "profiles", "include", "<<",
]
# fmt: on


def manifest_edits(chance: random.Random) -> Iterator[Edit]:
    """Some faults in a manifest."""
    for _ in range(chance.choice([1, 1, 2, 3])):
        value = chance.choice([*_PATHS, *_PATHS, *_VALUES])
        number = chance.randrange(2)
        pointer = chance.choice([["defaults"], ["jobs", number], ["jobs", number], ["jobs", number]])
        match chance.randrange(10):
            case 0:
                yield [
                    "set",
                    "manifest",
                    chance.choice(
                        [
                            ["version"],
                            ["jobs"],
                            ["defaults"],
                            ["include"],
                            ["profiles"],
                            ["profiles", "mobile"],
                            pointer,
                        ]
                    ),
                    value,
                ]
            case 1:
                yield ["drop", "manifest", [*pointer, chance.choice(_KEYS)]]
            case 2:
                yield ["repeat", "manifest", ["jobs", number], chance.choice([1, 2, 300])]
            case 3 | 4:
                place = chance.randrange(300)
                texts = [
                    b"[" * 3000,
                    b"&a [*a, *a]",
                    b"\0",
                    b"1e999",
                    b'"',
                    b"\xff\xfe",
                    b": ",
                    b"- ",
                    b",",
                    b";",
                    b"\n",
                ]
                deep = [b'\n{"asset": ' + b"[" * 100_000, b'{"asset": ' + b'{"a": ' * 100_000, b"[" * 200_000]
                floods = [b'{"a":1}\n', b'\n{"asset":"limb.glb"}', b"\n- {}", b",{}", b"a;", b"\n", b"\n5", b"\n\xff"]
                edits = (
                    ["put", "manifest bytes", chance.choice([0, place, 10**9]), chance.choice(deep).hex()],
                    ["flood", "manifest bytes", chance.choice(floods).hex(), chance.choice([300, 60_000])],
                    ["cut", "manifest bytes", place, chance.choice([1, 4, 64, 1000])],
                    ["flip", "manifest bytes", place, 1 << chance.randrange(8)],
                    ["put", "manifest bytes", place, chance.choice(texts).hex()],
                )
                yield chance.choice(edits)
            case _:
                outputs = (
                    "asset", "out", "report", "timings", "frames_dir", "maps_dir", "tracked", "tools", "anim", "anims",
                )  # fmt: skip
                key = chance.choice(outputs if chance.random() < 0.6 else _KEYS)
                yield ["set", "manifest", [*pointer, key], value]


def written(name: str, manifest: Any) -> bytes:
    """A manifest as its ending asks for; tables have no defaults, so that these go to each job."""
    if name.endswith(".yaml"):
        return json.dumps(manifest).encode("utf-8", "replace")
    jobs = manifest.get("jobs") if isinstance(manifest, dict) else manifest
    common = manifest.get("defaults") if isinstance(manifest, dict) else None
    common = common if isinstance(common, dict) else {}
    rows = [
        {**common, **each} if isinstance(each, dict) else each for each in (jobs if isinstance(jobs, list) else [jobs])
    ]
    if name.endswith(".jsonl"):
        return "\n".join(map(json.dumps, rows)).encode("utf-8", "replace")
    keys = list(dict.fromkeys(key for row in rows if isinstance(row, dict) for key in row))
    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(keys)
    for row in rows:
        cells = [row.get(key, "") for key in keys] if isinstance(row, dict) else [row]
        table.writerow([";".join(map(str, each)) if isinstance(each, list) else each for each in cells])
    return text.getvalue().encode("utf-8", "replace")


# What a batch leaves in a cache, and what somebody may make of it.


def placed(files: Mapping[str, bytes], folder: Path) -> dict[str, bytes]:
    """The files of a sound batch as they are in another folder."""
    made = {}
    for name, data in files.items():
        kind, _, out = name.partition(":")
        if kind == "outs" and out:
            digest = hashlib.sha256(os.path.abspath(folder / out).encode("utf-8", "surrogateescape")).hexdigest()
            name = f"kept/outs/{digest[:2]}/{digest}.json"
        made[name] = data
    return made


# fmt: off
_NAMED = [
    "limb.glb", "limb.gltf", "tools.yaml", "jobs.yaml", "../stray.glb", "../../stray.glb", "/nowhere/stray.glb",
    "sub", "cache/CACHEDIR.TAG", "sub/stray.glb", "stray.glb", "", ".", "..", "a\0b", "\ud800", "x" * 300,
    "x/" * 3000, "out.glb", "linked/x.glb", "~", "http://127.0.0.1:1/x", "memory://x",
]
_ROOTS = [
    "out", "report", "timings", "frames_dir", "maps_dir", "tracked", "", "none", "asset", "tools", 0, None, [],
    "../out",
]
_SAID = [None, 5, "NaN", float("nan"), float("inf"), -1e400, [], {}, [None], "\ud800", "\x1b[31m", "x" * 20000, 10**400]
# fmt: on


def forgeries(chance: random.Random) -> Iterator[Edit]:
    """Changes of a cache: of the record of a job, of the note about an output, or of any file."""
    for _ in range(chance.choice([1, 1, 2])):
        number = chance.choice([0, -1])
        match chance.randrange(9):
            case 0 | 1:
                yield ["set", "kept record", ["files", number, 1], chance.choice(_NAMED)]
            case 2:
                yield ["set", "kept record", ["files", number, 0], chance.choice(_ROOTS)]
            case 3:
                digests = [
                    "0" * 64,
                    "../../limb.glb",
                    "../CACHEDIR.TAG",
                    "",
                    5,
                    None,
                    "x" * 5000,
                    "\0",
                    "\ud800",
                    "limb.glb",
                ]
                yield ["set", "kept record", ["files", number, 2], chance.choice(digests)]
            case 4:
                pointer = chance.choice(
                    [["said"], ["said", chance.choice(["residual", "tallest", "summary", "warnings"])]]
                )
                yield ["set", "kept record", pointer, chance.choice(_SAID)]
            case 5:
                pointer = chance.choice([["files"], ["cache"], ["files", number], ["said"]])
                edits = (
                    ["drop", "kept record", pointer],
                    ["set", "kept record", pointer, chance.choice(_SAID)],
                    ["repeat", "kept record", ["files", number], chance.choice([1, 300])],
                    ["insert", "kept record", ["files", 0], ["out", chance.choice(_NAMED), "0" * 64]],
                )
                yield chance.choice(edits)
            case 6:
                edits = (
                    ["set", "kept note", ["parts"], chance.choice(_SAID)],
                    ["set", "kept note", ["parts", chance.choice(["asset", "tools", "names"])], chance.choice(_SAID)],
                    ["drop", "kept note", [chance.choice(["parts", "out"])]],
                )
                yield chance.choice(edits)
            case _:
                place = chance.randrange(400)
                which = chance.choice(["kept record", "kept note", "kept content", "kept tag"])
                data = [b"[" * 200_000, b"NaN", b"\0", b"\xff\xfe", b'"', b"\n" * 1000]
                edits = (
                    ["cut", f"{which} bytes", place, chance.choice([1, 64, 10**7])],
                    ["cut", f"{which} bytes", 0, 10**7],
                    ["flip", f"{which} bytes", place, 1 << chance.randrange(8)],
                    ["put", f"{which} bytes", chance.choice([0, place]), chance.choice(data).hex()],
                )
                yield chance.choice(edits)


_PARTS = {"record": "kept/keys/", "note": "kept/outs/", "content": "kept/files/", "tag": "kept/CACHEDIR.TAG"}


def forged(files: Mapping[str, bytes], edits: Sequence[Edit]) -> dict[str, bytes]:
    """The files of a batch after changes of its cache; with several of a kind, all of these are changed."""
    made = dict(files)
    for edit in [each for each in edits if each[1].startswith("kept ")]:
        _, _, part = edit[1].partition("kept ")
        kind, _, of_bytes = part.partition(" ")
        for name in [each for each in made if each.startswith(_PARTS[kind])]:
            if of_bytes:
                data = bytearray(made[name])
                edit_bytes(data, edit)
                made[name] = bytes(data)
            else:
                try:
                    tree = json.loads(made[name])
                except (ValueError, RecursionError):
                    continue
                edit_tree(tree, edit)
                made[name] = json.dumps(tree).encode()
    return made
