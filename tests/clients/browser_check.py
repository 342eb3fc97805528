"""Holds a baked file in PlayCanvas or model-viewer, in Chromium, against the player of the tests. Run by hand.

    apt-get install chromium
    npm install --prefix FOLDER playcanvas @google/model-viewer
    PYTHONPATH=tests python tests/clients/browser_check.py ENGINE BAKED.glb NODE CLIP FOLDER/node_modules

ENGINE is playcanvas or model-viewer; NODE's mesh has one primitive. What is compared is `gl_Position` as the engine's
own vertex shaders compute it, at eight times of the clip. It is the world-space position times a matrix, the
camera's, which is fitted to all vertices and times. Prints the greatest distance at each time, as part of the mesh's
size; above 1e-4 it fails.
"""

import subprocess
import sys
import tempfile
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Queue
from threading import Thread
from urllib.parse import urlencode

import numpy as np

from kit.player import Floats, Gltf
from kit.work import PATIENCE

# PlayCanvas adds morph targets up in half floats.
_TOLERANCE = 1e-4
_FRAMES = 8
_PAGE = '<!DOCTYPE html><body><script type="module" src="browser_check.mjs"></script>'
_CHROMIUM = ["chromium", "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


class _Handler(SimpleHTTPRequestHandler):
    """Serves a folder, and takes what the page sends."""

    def __init__(self, *arguments: object, answers: "Queue[tuple[str, bytes]]", **options: object) -> None:
        self._answers = answers
        super().__init__(*arguments, **options)  # type: ignore[arg-type]

    def do_POST(self) -> None:
        self._answers.put((self.path, self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Nothing."""


def shown(engine: str, path: Path, asked: dict[str, object], modules: Path) -> Floats:
    """(times, vertices, 4) gl_Position in an engine."""
    answers: Queue[tuple[str, bytes]] = Queue()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "index.html").write_text(_PAGE)
        (folder / "in.glb").symlink_to(path.resolve())
        (folder / "node_modules").symlink_to(modules.resolve())
        (folder / "browser_check.mjs").symlink_to(Path(__file__).resolve().with_suffix(".mjs"))
        handler = partial(_Handler, answers=answers, directory=name)
        with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            page = f"http://127.0.0.1:{server.server_port}/?{urlencode({'engine': engine, **asked})}"
            command = [*_CHROMIUM, f"--user-data-dir={name}/profile", "--remote-debugging-port=0", page]
            browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                where, body = answers.get(timeout=PATIENCE)
            finally:
                browser.terminate()
                browser.wait()
                server.shutdown()
    if where != "/shown":
        sys.exit(f"{engine}: {body.decode()}")
    return np.frombuffer(body, np.float32).reshape(_FRAMES, -1, 4).astype(np.float64)


def main(engine: str, path: Path, node: str, clip: str, modules: Path) -> int:
    """Compare; the exit code."""
    file = Gltf(path)
    (primitive,) = file.mesh(node)["primitives"]
    keys, _ = file.keys(clip, node)
    times = np.linspace(keys[0], keys[-1], _FRAMES, endpoint=False)
    wanted = file.pose(node, clip, times)
    asked = {
        "clip": clip,
        "times": ",".join(map(repr, times.tolist())),
        "indices": file.json["accessors"][primitive["indices"]]["count"],
        "vertices": wanted.shape[1],
    }
    found = shown(engine, path, asked, modules)
    ones = np.ones((*wanted.shape[:2], 1))
    places = np.concatenate([wanted, ones], axis=2)
    camera = np.linalg.lstsq(places.reshape(-1, 4), found.reshape(-1, 4), rcond=None)[0]
    # Back from the screen to the world: x, y and w tell the position, z only says it again.
    camera = camera[:, [0, 1, 3]]
    back = (found[..., [0, 1, 3]] - camera[3]) @ np.linalg.inv(camera[:3])
    wrinkles = np.einsum("tk,kvx->tvx", file.weights(node, clip, times), file.deltas(node))
    size = np.ptp(wanted.reshape(-1, 3), axis=0).max()
    gaps, heights = (np.linalg.norm(each, axis=2).max(axis=1) / size for each in (back - wanted, wrinkles))
    for time, gap, height in zip(times, gaps, heights, strict=True):
        print(f"{time:8.3f} s  off by {gap:.2g}; morph targets move up to {height:.2g}")
    return int(gaps.max() > _TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), sys.argv[3], sys.argv[4], Path(sys.argv[5])))
