"""How long a frame of baked files takes three.js in Chromium that draws without a GPU (SwiftShader), files in turns.

Needs Chromium, node's packages (`npm ci` in tests/clients) and websockets.
"""

import json
import shutil
import tempfile
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

from kit.browser import browsing

HERE = Path(__file__).resolve().parent
_MODULES = HERE.parent / "clients" / "node_modules"
_IMPORTS = {"three": "three/build/three.module.js", "three/addons/": "three/examples/jsm/"}
_MAP = json.dumps({"imports": {name: f"./node_modules/{path}" for name, path in _IMPORTS.items()}})
_PAGE = (
    f"""<!DOCTYPE html><body><script type="importmap">{_MAP}</script><script type="module" src="drawn.mjs"></script>"""
)


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Nothing."""


def missing() -> str:
    """Say which program is missing; empty if none is."""
    if shutil.which("chromium") is None:
        return "no chromium"
    return "" if _MODULES.is_dir() else "no packages of node (`npm ci` in tests/clients)"


def frame_times(files: list[Path], clip: str, frames: int = 60) -> list[float]:
    """Median milliseconds of a frame of each file, which show the same: the clip plays, seen as a whole.

    Args:
        files: Baked files, .glb.
        clip: The name of a clip that all of them have.
        frames: Frames that are drawn.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "index.html").write_text(_PAGE)
        (folder / "node_modules").symlink_to(_MODULES.resolve())
        (folder / "drawn.mjs").symlink_to(HERE / "drawn.mjs")
        for number, file in enumerate(files):
            (folder / f"{number}.glb").symlink_to(file.resolve())
        (folder / "asked.json").write_text(json.dumps({"count": len(files), "clip": clip, "frames": frames}))
        with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=name)) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            with browsing(folder, f"http://127.0.0.1:{server.server_port}/") as page:
                found = page.wait("window.found")
            server.shutdown()
    if isinstance(found, str):
        raise RuntimeError(found)
    return [float(each) for each in found]
