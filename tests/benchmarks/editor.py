"""How fast the page of `wrinkle edit` answers: what of an edit or a moment takes place before a tab is told.

    python tests/benchmarks/editor.py                     the samples, and a limb of 27,000 triangles
    python tests/benchmarks/editor.py ASSET [TOOLS]       another asset; without tools the first that is suggested

For each: triangles, vertices shown, frames a second of the first clip as it plays, and milliseconds of an edit of the
first tool while it is dragged (its width, one of its ends, its bumps) and until it is refined again. Medians by the
clock, and of the processor time of the thread that does it, which counts other programs on the machine little; one tab
takes all that is sent and draws nothing. `run.py --only edits` holds the same against how long a hand waits.
"""

import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import viser  # noqa: E402
from websockets.sync.client import ClientConnection, connect  # noqa: E402

from kit.limb import limb  # noqa: E402
from wrinklecli.editor.baked_file import SavedBake  # noqa: E402
from wrinklecli.editor.page.page import Page  # noqa: E402
from wrinklecli.editor.session import Session  # noqa: E402
from wrinklecli.numeric.guard import guarded  # noqa: E402

_LIMB_TOOLS = """\
version: 1
tools:
  - {name: crease, origin: [-0.4, 0.25, 0.0], target: [0.4, 0.25, 0.0], width: 0.3, bumps: 3}
  - {name: across, origin: [-0.2, 0.2, 0.15], target: [0.2, 0.2, 0.15], width: 0.2, bumps: 2}
"""


_LIMB_FLESH = """\
version: 1
flesh:
  - {name: soft, at: [0.6, -0.25, 0.0], radius: 0.35}
"""


@dataclass(frozen=True)
class Felt:
    """How long a hand waits.

    Attributes:
        name: Of the asset.
        triangles: Of it.
        vertices: That are shown.
        clock: Medians by the clock, seconds: `frame`, `width`, `end` and `bumps`; `refined` but once. See `felt_flesh`.
        processor: The same of processor time.
    """

    name: str
    triangles: int
    vertices: int
    clock: dict[str, float]
    processor: dict[str, float]

    def __str__(self) -> str:
        """A line."""
        found = [f"{what} {1000 * self.clock[what]:.0f}/{1000 * self.processor[what]:.0f}" for what in self.clock]
        return f"{self.name:16}{self.triangles:8,} triangles{self.vertices:8,} vertices   ms: {', '.join(found)}"


def felt(asset: Path, tools: Path, edits: int = 20) -> Felt:
    """Measure an asset, with so many edits of each kind; the tools file is written to."""
    session = Session(asset, tools)
    if not session.tools():
        session.accept(session.proposals()[0])
    page, tab = _opened(session)
    tool, clip = session.tools()[0].name, session.clips[0].name
    times = session.frame_times(clip)
    page.choose(tool, look=False)
    session.refine()
    (place, *_) = session.attached_tools()[tool].region.anchors
    shown = session.meshes(clip, float(times[0]))

    def moved(number: int, *, draft: bool) -> None:
        along = number * 1e-3 * session.attached_tools()[tool].region.path.along
        session.move_point(tool, 0, (place.position + along).tolist(), draft=draft)

    jobs: dict[str, Callable[[int], object]] = {
        "frame": lambda n: page.player.go(clip, float(times[n * 3 % len(times)])),
        "width": lambda n: page.slide(
            "width", lambda draft: session.set_value(tool, ("width",), f"{80 + n}%", draft=draft)
        ),
        "end": lambda n: page.slide("end", lambda draft: moved(n, draft=draft)),
        "bumps": lambda n: page.slide(
            "bumps", lambda draft: session.set_value(tool, ("bumps",), 2 + n % 3, draft=draft)
        ),
    }
    # On this thread from here on, and nothing beside it.
    page.stop_work()
    clock, processor = {}, {}
    with guarded(str(asset)):
        for what, job in jobs.items():
            clock[what], processor[what] = _medians(job, edits)
            page.commit()
        clock["refined"], processor["refined"] = _medians(lambda _: session.refine(), 1)
    tab.close()
    page.close()
    triangles = sum(len(mesh.source.ground.surface.triangles) for mesh in shown)
    return Felt(asset.stem, triangles, sum(len(mesh.positions) for mesh in shown), clock, processor)


def felt_flesh(folder: Path, edits: int = 20) -> Felt:
    """Measure a region on a limb of 27,000 triangles: a slider while its clip plays, and a second bake.

    The times are `frame`, `frequency` (a step of the slider, and the frame that shows it) and `again` (a bake after
    another one that differs by the frequency alone).
    """
    asset, tools = limb(folder / "flesh.glb", rings=225, sides=60), folder / "flesh.yaml"
    tools.write_text(_LIMB_FLESH)
    session = Session(asset, tools)
    page, tab = _opened(session)
    clip = session.clips[0].name
    times = session.frame_times(clip)
    page.choose("soft", look=False)
    session.refine()
    page.stop_work()
    jobs: dict[str, Callable[[int], object]] = {
        "frame": lambda n: page.player.go(clip, float(times[n * 3 % len(times)])),
        "frequency": lambda n: page.slide(
            "frequency",
            lambda draft: session.set_value("soft", ("frequency",), round(2.0 + 0.1 * (n % 50), 2), draft=draft),
        ),
    }
    clock, processor = {}, {}
    with guarded(str(asset)):
        for what, job in jobs.items():
            clock[what], processor[what] = _medians(job, edits)
            page.commit()
    session.save()
    SavedBake.of(session, str(folder / "cache")).run()
    session.set_value("soft", ("frequency",), 7.5)
    session.save()
    clock["again"], processor["again"] = _medians(lambda _: SavedBake.of(session, str(folder / "cache")).run(), 1)
    tab.close()
    page.close()
    (shown,) = session.meshes(clip, float(times[0]))
    return Felt("flesh", len(shown.source.ground.surface.triangles), len(shown.positions), clock, processor)


def _opened(session: Session) -> tuple[Page, ClientConnection]:
    """A page, and a tab that takes all that is sent and draws nothing."""
    page = Page(session)
    tab = connect(page.address.replace("http", "ws", 1), subprotocols=[f"viser-v{viser.__version__}"], max_size=None)
    threading.Thread(target=lambda: [None for _ in tab], daemon=True).start()
    return page, tab


def _medians(job: Callable[[int], object], times: int) -> tuple[float, float]:
    """Median seconds of a job by the clock and of the processor, called with how often it has been done."""
    every: list[tuple[float, float]] = []
    for number in range(times):
        start = time.perf_counter(), time.thread_time()
        job(number)
        every.append((time.perf_counter() - start[0], time.thread_time() - start[1]))
    clock, processor = zip(*every, strict=True)
    return statistics.median(clock), statistics.median(processor)


def cases(folder: Path) -> list[tuple[Path, Path]]:
    """The samples and a limb of 27,000 triangles, each with a tools file in a folder."""
    found = []
    for sample in ("trousers", "head", "wrist"):
        tools = folder / f"{sample}.yaml"
        tools.write_text((ROOT / "configs" / tools.name).read_text())
        found.append((ROOT / "samples" / f"{sample}.glb", tools))
    tools = folder / "limb.yaml"
    tools.write_text(_LIMB_TOOLS)
    return [*found, (limb(folder / "limb.glb", rings=225, sides=60), tools)]


def main(arguments: list[str]) -> None:
    """Print a line for each asset."""
    with tempfile.TemporaryDirectory() as name:
        folder, chosen = Path(name), []
        if arguments:
            tools = folder / "tools.yaml"
            if len(arguments) > 1:
                tools.write_text(Path(arguments[1]).read_text())
            chosen = [(Path(arguments[0]), tools)]
        for asset, tools in chosen or cases(folder):
            print(felt(asset, tools))
        if not arguments:
            print(felt_flesh(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
