"""How fast the page of `wrinkle edit` answers: what of an edit or a moment takes place before a tab is told.

    python tests/benchmarks/editor.py                     the samples' trousers and head, and a limb of 27,000 triangles
    python tests/benchmarks/editor.py ASSET TOOLS         another asset

For each: triangles, vertices shown, frames a second of the first clip as it plays, and milliseconds of an edit of the
first tool while it is dragged (its width, one of its ends) and until it is refined again. Medians of the processor
time of the thread that does it, so that other programs on the machine count little; one tab takes all that is sent
and draws nothing.
"""

import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import viser  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from kit.limb import limb  # noqa: E402
from wrinklecli.editor.page.page import Page  # noqa: E402
from wrinklecli.editor.page.served import Place  # noqa: E402
from wrinklecli.editor.session import Session  # noqa: E402
from wrinklecli.numeric.guard import guarded  # noqa: E402

_TIMES = 20
_LIMB_TOOLS = """\
version: 1
tools:
  - {name: crease, origin: [-0.4, 0.25, 0.0], target: [0.4, 0.25, 0.0], width: 0.3, bumps: 3}
  - {name: across, origin: [-0.2, 0.2, 0.15], target: [0.2, 0.2, 0.15], width: 0.2, bumps: 2}
"""


def milliseconds(action: Callable[[int], object]) -> float:
    """The median of an action, called with how often it has been done."""
    found = []
    for number in range(_TIMES):
        start = time.thread_time()
        action(number)
        found.append(1000 * (time.thread_time() - start))
    return statistics.median(found)


def measure(name: str, asset: Path, tools: Path, folder: Path) -> None:
    """Print a row."""
    copied = folder / tools.name
    copied.write_text(tools.read_text())
    session = Session.open(asset, copied)
    page = Page(session, Place())
    tab = connect(f"ws://127.0.0.1:{page.port}", subprotocols=[f"viser-v{viser.__version__}"], max_size=None)
    threading.Thread(target=lambda: [None for _ in tab], daemon=True).start()
    tool = session.tools()[0].name
    clip = session.clips[0].name
    times = session.frame_times(clip)
    page.choose(tool, look=False)
    session.settle()
    (place, *_) = session.laid()[tool].patch.anchors
    shown = session.meshes(clip, float(times[0]))
    # On this thread from here on, and nothing beside it.
    page.rest()
    with guarded(str(asset)):
        frame = milliseconds(lambda number: page.player.go(clip, float(times[number * 3 % len(times)])))
        width = milliseconds(
            lambda n: page.slide("width", lambda draft: session.set_value(tool, ("width",), f"{80 + n}%", draft=draft))
        )
        page.settle()
        end = milliseconds(
            lambda n: page.slide(
                "end",
                lambda draft: session.move_point(
                    tool, 0, (place.position + n * 1e-3 * session.laid()[tool].patch.along).tolist(), draft=draft
                ),
            )
        )
        page.settle()
        start = time.thread_time()
        session.settle()
        refined = 1000 * (time.thread_time() - start)
    triangles = sum(len(mesh.laid.ground.surface.triangles) for mesh in shown)
    points = sum(len(mesh.positions) for mesh in shown)
    print(
        f"{name:24}{triangles:10,} triangles{points:10,} vertices{1000 / frame:7.0f} frames/s"
        f"   width {width:.0f} ms, end {end:.0f} ms, refined {refined:.0f} ms"
    )
    tab.close()
    page.close()


def main(arguments: list[str]) -> None:
    """Print a row for each asset."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments:
            measure(Path(arguments[0]).name, Path(arguments[0]), Path(arguments[1]), folder)
            return
        for sample in ("trousers", "head"):
            measure(sample, ROOT / "samples" / f"{sample}.glb", ROOT / "configs" / f"{sample}.yaml", folder)
        (folder / "limb_tools.yaml").write_text(_LIMB_TOOLS)
        measure("limb", limb(folder / "limb.glb", rings=225, sides=60), folder / "limb_tools.yaml", folder)


if __name__ == "__main__":
    main(sys.argv[1:])
