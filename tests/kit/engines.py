"""Engines and libraries that tests hold a bake against, besides those of `kit.clients`.

Babylon.js, Filament and Godot 4 come with node's other packages, VTK with `pip install '.[test-more]'`, assimp with
Debian's `assimp-utils`, Chromium with `chromium`.
A test that needs what is not there is skipped with the reason; where `CI` is set it fails instead.
"""

import base64
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlencode

import numpy as np

from kit.asset import pack_glb, read_glb
from kit.browser import Page, browsing, serving
from kit.clients import HERE, Floats, ask, give_up, need, requireinstall
from kit.player import Gltf


def babylon_pose(file: Path, node: str, clip: str, times: Sequence[float]) -> Floats:
    """(times, vertices, 3) world-space positions of a node's mesh as Babylon.js computes them."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "posed.f32")
        request = {"file": str(file), "node": node, "clip": clip, "times": [*map(float, times)], "output": str(output)}
        answer = ask("babylon", "pose", request)
        return np.fromfile(output, np.float32).reshape(len(times), answer["vertices"], 3).astype(np.float64)


def browser_pose(
    engine: str,
    file: Gltf,
    node: str,
    clip: str,
    times: Sequence[float],
    posed: Floats,
    modules: Path | None = None,
) -> Floats:
    """(times, vertices, 3) world-space positions as `browser_page` finds them."""
    with browser_page(engine, file, node, clip, times, posed, modules) as (shown, _):
        return shown


@contextmanager
def browser_page(
    engine: str,
    file: Gltf,
    node: str,
    clip: str,
    times: Sequence[float],
    posed: Floats,
    modules: Path | None = None,
    *,
    more: Sequence[Path] = (),
) -> Iterator[tuple[Floats, Page]]:
    """Positions as the vertex shaders of an engine in Chromium compute them, and the page, which still shows the file.

    They leave `gl_Position`, a position times a matrix, the camera's, which is fitted to all vertices and times.

    Args:
        engine: One of those in `clients/browser_check.mjs`.
        file: A .glb.
        node: The name of a node whose mesh has one primitive.
        clip: The name of an animation.
        times: Seconds.
        posed: (times, vertices, 3) positions that are expected.
        modules: The folder with the engine's package; if None, that of the tests.
        more: Files and folders that the page loads besides, by their names.

    Yields:
        (times, vertices, 3) world-space positions, and the page.
    """
    (primitive,) = file.mesh(node)["primitives"]
    asked = {
        "engine": engine,
        "clip": clip,
        "times": ",".join(repr(float(time)) for time in times),
        "indices": file.json["accessors"][primitive["indices"]]["count"],
        "vertices": posed.shape[1],
    }
    if modules is None:
        requireinstall()
        modules = HERE / "node_modules"
    # Children of the browser outlive it for a moment, and write into its profile.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        (folder / "index.html").write_text("<!DOCTYPE html><body></body>")
        (folder / "in.glb").symlink_to(file.path.resolve())
        (folder / "node_modules").symlink_to(modules.resolve())
        for each in (HERE / "browser_check.mjs", *more):
            (folder / each.name).symlink_to(each.resolve())
        with serving(folder) as address, browsing(folder, f"{address}/?{urlencode(asked)}") as page:
            page.wait("location.search !== ''")
            data = page.value(f"import('{address}/browser_check.mjs').then((each) => each.shown)")
            seen = np.frombuffer(base64.b64decode(data), np.float32).reshape(len(times), -1, 4).astype(np.float64)
            places = np.concatenate([posed, np.ones((*posed.shape[:2], 1))], axis=2)
            camera = np.linalg.lstsq(places.reshape(-1, 4), seen.reshape(-1, 4), rcond=None)[0]
            # Back from the screen to the world: x, y and w tell the position, z only says it again.
            camera = camera[:, [0, 1, 3]]
            yield (seen[..., [0, 1, 3]] - camera[3]) @ np.linalg.inv(camera[:3]), page


def vtk_pose(file: Path, clip: int, times: Sequence[float]) -> Floats:
    """(times, vertices, 3) positions of a file with one mesh as VTK computes them: in the space of the scene."""
    need("vtkmodules")
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
