"""Engines and libraries that tests hold a bake against, besides those of `kit.clients`: Babylon.js, VTK and assimp.

Babylon.js comes with node's other packages, VTK with `pip install '.[engines]'`, assimp with Debian's `assimp-utils`.
A test that needs what is not there is skipped with the reason; where `CI` is set it fails instead.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kit.asset import pack_glb, read_glb
from kit.clients import HERE, Floats, ask, give_up
from kit.player import Gltf


def babylon_pose(file: Path, node: str, clip: str, times: Sequence[float]) -> Floats:
    """(times, vertices, 3) world-space positions of a node's mesh as Babylon.js computes them."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "posed.f32")
        request = {"file": str(file), "node": node, "clip": clip, "times": [*map(float, times)], "output": str(output)}
        answer = ask("babylon", "pose", request)
        return np.fromfile(output, np.float32).reshape(len(times), answer["vertices"], 3).astype(np.float64)


def vtk_pose(file: Path, clip: int, times: Sequence[float]) -> Floats:
    """(times, vertices, 3) positions of a file with one mesh as VTK computes them: in the space of the scene."""
    if importlib.util.find_spec("vtkmodules") is None:
        give_up("VTK is not installed: pip install '.[engines]'")
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "posed.npy")
        command = [sys.executable, HERE / "vtk_pose.py", file, str(clip), output, *(repr(float(t)) for t in times)]
        done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
        assert done.returncode == 0, f"VTK: exit code {done.returncode}: {done.stderr.strip()[-2000:]}"
        assert "ERR" not in done.stderr, f"VTK: {done.stderr.strip()[-2000:]}"
        posed: Floats = np.load(output)
        return posed


def assimp(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run `assimp`."""
    if shutil.which("assimp") is None:
        give_up("assimp is not installed: apt-get install assimp-utils")
    return subprocess.run(["assimp", *arguments], capture_output=True, text=True, encoding="utf-8", check=False)


def through_assimp(file: Path, folder: Path) -> Gltf:
    """A file as assimp reads it and writes it again.

    Without extras: before version 5.3, assimp cannot copy objects and lists among them, and `export` copies
    (https://github.com/assimp/assimp/pull/5092).
    """
    gltf, data = read_glb(file.read_bytes())
    for node in gltf["nodes"]:
        node.pop("extras", None)
    bare, made = folder / "bare.glb", folder / "assimp.glb"
    bare.write_bytes(pack_glb(json.dumps(gltf).encode(), data))
    done = assimp("export", bare, made, "-fglb2")
    assert done.returncode == 0, f"assimp: {(done.stdout + done.stderr)[-2000:]}"
    return Gltf(made)
