"""What baking costs, each as a ratio to something measured in the same run on the same machine.

    python tests/benchmarks/run.py                          all rows, printed as a table
    python tests/benchmarks/run.py --only frames --only help  some
    python tests/benchmarks/run.py --release 0.2.0          also as a row of results.csv
    python tests/benchmarks/run.py --assets DIR             with hand.glb and simple_skin.gltf from there
    python tests/benchmarks/run.py --markdown               the table as Markdown, on stdout

The rows that Blender is measured in need `bpy` in an environment of its own, which tests/benchmarks/blender.sh makes.
There Blender does what blender_keyshapes.py says, with as many threads as it likes.
Medians of several runs, alternating with what they are compared with, one thread.

The paper's figures: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on a 1.7 GHz PC.
"""

import argparse
import csv
import importlib.util
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

# Where it is set, what is installed in place is compiled at every start, unlike the packages that it is compared with.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
_unlimited = dict(os.environ)
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_threads] = "1"

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(HERE), str(ROOT / "tests")]

import numpy as np  # noqa: E402
import yaml  # noqa: E402
from assets import finer, longer, more_clips  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import wrinklecli  # noqa: E402
from kit.crowd import write_crowds, write_frames  # noqa: E402
from kit.limb import limb_asset, nose, sleeved_limb, waving_limb, write_tools  # noqa: E402
from kit.limb import tool as limb_tool  # noqa: E402
from kit.tube import write_tube  # noqa: E402
from wrinklecli.character.clip import Clip, read_clips  # noqa: E402
from wrinklecli.character.pose import joint_matrices, morph_weights  # noqa: E402
from wrinklecli.character.skin import pose, prepare  # noqa: E402
from wrinklecli.character.surface import read_triangles  # noqa: E402
from wrinklecli.effects.effect import MeshPlan  # noqa: E402
from wrinklecli.effects.plan import plan_mesh  # noqa: E402
from wrinklecli.effects.wrinkle.activity import activities  # noqa: E402
from wrinklecli.effects.wrinkle.layer import carried_patches_of  # noqa: E402
from wrinklecli.effects.wrinkle.shapes import shapes_of  # noqa: E402
from wrinklecli.effects.wrinkle.weights import weights_of  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.review.crossings import crossings  # noqa: E402
from wrinklecli.tools.read import load_tools  # noqa: E402
from wrinklecli.tools.records import Length  # noqa: E402

Floats = NDArray[np.float64]
Command = tuple[str | Path, ...]

# Sample, levels, and the paper's frames per second.
WORKLOADS = (("head", 1, 13.0), ("head", 2, 3.6), ("wrist", 0, 188.0), ("wrist", 2, 23.0), ("trousers", 1, 17.0))
CHUNK = 250  # frames
LONGER = 50_000  # frames: what they cost is to stand out from how unevenly processes start
REPEATS = 9
FPS = 30


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: What was measured, without spaces: a column of results.csv.
        what: The same for people.
        over: What it is compared with.
        ratio: The one over the other.
        reach: The ratio to reach, and
        least: whether it is the least; else the most.
        shown: What was measured, with its unit.
    """

    name: str
    what: str
    over: str
    ratio: float
    reach: float
    least: bool
    shown: str

    @property
    def held(self) -> bool:
        """Whether the ratio was reached."""
        return self.ratio >= self.reach if self.least else self.ratio <= self.reach

    @property
    def wanted(self) -> str:
        """The ratio to reach, for people."""
        return f"{'≥' if self.least else '≤'} {self.reach:g}"

    def __str__(self) -> str:
        """A line."""
        verdict = "ok " if self.held else "NOT"
        return f"{verdict} {self.what}, over {self.over}: {self.ratio:.3g} ({self.wanted}), {self.shown}"


@dataclass(frozen=True)
class Places:
    """Where things are.

    Attributes:
        folder: For what is made.
        assets: Assets that the project does not have.
        blender: A Python that can import bpy, if there is one.
    """

    folder: Path
    assets: Path
    blender: str | None


def timed(*jobs: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Median seconds of jobs that take turns."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for _ in range(repeats):
        for job, into in zip(jobs, seconds, strict=True):
            start = time.perf_counter()
            job()
            into.append(time.perf_counter() - start)
    return [statistics.median(each) for each in seconds]


def run(*command: str | Path, code: str = "", blender: str | None = None) -> float:
    """Seconds of a process of this Python, or of Blender's with all its threads."""
    arguments = [blender or sys.executable, *(("-c", code) if code else ()), *map(str, command)]
    start = time.perf_counter()
    subprocess.run(
        arguments,
        cwd=ROOT,
        env=_unlimited if blender else None,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    return time.perf_counter() - start


# A process counts what its parent held when it began, so the parent must be small: not this one, but one between.
WATCH = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
taken = resource.getrusage(resource.RUSAGE_CHILDREN)
print(taken.ru_utime + taken.ru_stime, taken.ru_maxrss)
"""


def watched(*command: str | Path, code: str) -> tuple[float, float]:
    """Processor seconds, and greatest memory in MB (Linux counts in KB), of a process of this Python."""
    arguments = [sys.executable, "-S", "-c", WATCH, sys.executable, "-c", code, *map(str, command)]
    done = subprocess.run(arguments, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True)
    seconds, peak = done.stdout.split()[-2:]
    return float(seconds), float(peak) / 1024


WRINKLE = "from wrinklecli.cli import main; main()"


def bake(asset: Path, tools: Path, out: Path, *options: str) -> float:
    """Seconds of a bake, as a process."""
    return run("bake", asset, tools, "-o", out, "-q", *options, code=WRINKLE)


def planned(sample: str, levels: int) -> tuple[MeshPlan, Clip]:
    """A sample's tools, attached and refined, and its first clip."""
    document = read_document(ROOT / "samples" / f"{sample}.glb")
    settings = load_tools(ROOT / "configs" / f"{sample}.yaml")
    settings = replace(settings, refinement=replace(settings.refinement, max_levels=levels))
    node = next(index for index, each in enumerate(document.items("nodes")) if "mesh" in each)
    clips = read_clips(document)
    tools = list(settings.tools)
    return plan_mesh(document, node, tools, settings, clips, Length(1.0, percent=True)), clips[0]


def frames(_: Places) -> Iterator[Row]:
    """Posed and wrinkled positions and normals of all members, in process."""
    for workload in WORKLOADS:
        yield from finished(*workload)


def finished(sample: str, levels: int, paper: float) -> Iterator[Row]:
    """The frames of one workload."""
    plan, clip = planned(sample, levels)
    rig, fine = plan.rig, plan.fine
    patches = [each.patch for each in carried_patches_of(plan)]
    members = np.unique(np.concatenate([each.vertices for each in carried_patches_of(plan)]))
    weights, positions = fine.dense_weights(members, len(rig.joints)), fine.positions[members]
    every = [shape for each in carried_patches_of(plan) for shape in shapes_of(each, fine, plan.rest, plan.rest.pose)]
    shown = [shape is not None for shape in every]
    shapes = [shape for shape in every if shape is not None]
    old = fine.morph_deltas[:, members]
    deltas = np.array([spread(each.vertices, each.deltas, members) for each in shapes])
    turns = np.array([spread(each.normal_vertices, each.normal_deltas, members) for each in shapes])
    skin = prepare(
        weights,
        positions,
        np.concatenate([old, deltas]),
        fine.normals[members],
        np.concatenate([np.zeros_like(old), turns]),
    )
    times = np.linspace(clip.start, clip.end, CHUNK)

    def heights() -> Floats:
        seen = activities(patches, rig, clip, times)
        found = [weights_of(p.curve, s.amplitudes).reshape(CHUNK, -1) for p, s in zip(patches, seen, strict=True)]
        return np.concatenate([morph_weights(rig, clip, times), np.concatenate(found, axis=1)[:, shown]], axis=1)

    known, played = joint_matrices(rig, clip, times), heights()
    homogeneous = np.concatenate([positions, np.ones((len(members), 1))], axis=1)

    def floor() -> None:
        rows = known[:, :, :3].transpose(1, 0, 2, 3).reshape(known.shape[1], -1)
        np.matmul((weights @ rows).reshape(len(weights), -1, 4), homogeneous[:, :, None])

    whole, finishing, least = timed(
        lambda: pose(skin, joint_matrices(rig, clip, times), heights()), lambda: pose(skin, known, played), floor
    )
    label = f"{sample}, max_levels {levels}, {len(members)} members"
    rate = CHUNK / whole
    what, over = f"finished frames a second, {label}", f"the paper's {paper:g}"
    yield Row(f"frames_{sample}_{levels}", what, over, rate / paper, 100, True, f"{rate:,.0f}/s")
    what, over = f"time to pose and wrinkle, {label}", "skinning positions alone"
    each = f"{1e9 * finishing / CHUNK / len(members):.0f} ns per vertex"
    yield Row(f"floor_{sample}_{levels}", what, over, finishing / least, 3, False, each)


def spread(vertices: NDArray[np.intp], values: Floats, members: NDArray[np.intp]) -> Floats:
    """(members, 3) of values of some vertices, 0 elsewhere."""
    dense = np.zeros((int(max(members.max(), vertices.max(initial=0))) + 1, 3))
    dense[vertices] = values
    return dense[members]


def rates(places: Places) -> Iterator[Row]:
    """What a longer clip costs more."""
    for sample, levels, paper in WORKLOADS:
        rate = LONGER / longer_costs(places.folder, sample, levels)
        what = f"frames of a longer clip that a bake takes a second, {sample}, max_levels {levels}"
        yield Row(f"bake_{sample}_{levels}", what, f"the paper's {paper:g}", rate / paper, 500, True, f"{rate:,.0f}/s")


def longer_costs(folder: Path, sample: str, levels: int) -> float:
    """Seconds that `LONGER` frames more take."""
    asset, tools = ROOT / "samples" / f"{sample}.glb", ROOT / "configs" / f"{sample}.yaml"
    short = longer(asset, folder / f"{sample}_short.glb", 100 / FPS)
    long = longer(asset, folder / f"{sample}_long.glb", (LONGER + 100) / FPS)

    def job(clip: Path) -> None:
        bake(clip, tools, folder / "out.glb", "--max-levels", str(levels))

    brief, extended = timed(lambda: job(short), lambda: job(long), repeats=7)
    return extended - brief


def growth(places: Places) -> Iterator[Row]:
    """Bytes, memory and time of long clips."""
    folder = places.folder
    tools, asset = ROOT / "configs" / "trousers.yaml", ROOT / "samples" / "trousers.glb"
    clips = {count: longer(asset, folder / f"trousers_{count}.glb", count / FPS) for count in (100, 1000, 10_000)}
    for mode, reach in (("morph", 1.5), ("frames", 2.5)):
        peaks, seconds = {}, {}
        for count in (100, 10_000):
            command = ("bake", clips[count], tools, "-o", folder / f"{mode}_{count}.glb", "-q", "--mode", mode)
            runs = [watched(*command, code=WRINKLE) for _ in range(3)]
            peaks[count] = statistics.median(peak for _, peak in runs)
            seconds[count] = statistics.median(each for each, _ in runs)
        what = f"peak memory, trousers, --mode {mode}, 10,000 frames"
        yield Row(
            f"memory_{mode}", what, "100 frames", peaks[10_000] / peaks[100], reach, False, f"{peaks[10_000]:.0f} MB"
        )
        per_frame = seconds[10_000] / 10_000 / (seconds[100] / 100)
        what, shown = (
            f"time per frame, trousers, --mode {mode}, 10,000 frames",
            f"{1e3 * seconds[10_000] / 10_000:.2f} ms",
        )
        yield Row(f"pace_{mode}", what, "100 frames", per_frame, 1.0, False, shown)
    grown, tracks = [], []
    for count in (1000, 10_000):
        out = folder / f"growth_{count}.glb"
        bake(clips[count], tools, out)
        grown.append(out.stat().st_size - clips[count].stat().st_size)
        tracks.append(track_bytes(out))
    what, over = "bytes that ten times the frames add, trousers", "those that they add to the weight tracks"
    ratio = (grown[1] - grown[0]) / (tracks[1] - tracks[0])
    yield Row("bytes", what, over, ratio, 1.001, False, f"{(grown[1] - grown[0]) / 1e3:,.0f} kB")


def track_bytes(path: Path) -> int:
    """Bytes of a file's weight tracks, times and values."""
    document = read_document(path)
    total = 0
    for animation in document.items("animations"):
        for channel in animation["channels"]:
            if channel["target"].get("path") == "weights":
                sampler = animation["samplers"][channel["sampler"]]
                total += sum(4 * document.accessor(sampler[key]).size for key in ("input", "output"))
    return total


def scaling(places: Places) -> Iterator[Row]:
    """How time and memory grow with what a file has many of: exponents, beyond what few take."""
    folder = places.folder
    picture = ("-o", folder / "many.png", "-q")

    def baked(count: int) -> Command:
        return "bake", *write_tube(folder, count), "-q", "-o", folder / "tube.glb"

    # Of instances so many that they, and not what draws them, take the memory.
    tools, instances, frames = (5, 100, 400), (400, 1600, 6400), (10, 200, 800)
    yield from grown("tools", tools, baked)
    yield from grown("tools", tools, lambda count: ("check", *write_tube(folder, count)))
    yield from grown("instances", instances, lambda count: ("diff", *write_crowds(folder, count)))
    yield from grown("instances", instances, lambda count: ("preview", write_crowds(folder, count)[0], *picture))
    yield from grown("frames", frames, lambda count: ("diff", *write_frames(folder, count)))
    yield from grown("frames", frames, lambda count: ("preview", write_frames(folder, count)[0], *picture))


def grown(name: str, counts: tuple[int, int, int], command: Callable[[int], Command]) -> Iterator[Row]:
    """The exponents of a command's time and memory, from few, some and many of what it is given."""
    few, some, many = counts
    commands = {count: command(count) for count in counts}
    # In turns, so that what else the machine does disturbs all of them.
    runs = [[watched(*each, code=WRINKLE) for each in commands.values()] for _ in range(3)]
    taken = dict(zip(counts, np.median(runs, axis=0), strict=True))
    exponents = np.log((taken[many] - taken[few]) / (taken[some] - taken[few])) / np.log((many - few) / (some - few))
    verb = commands[many][0]
    for what, exponent, unit, value in zip(("time", "memory"), exponents, ("s", "MB"), taken[many], strict=True):
        label = f"exponent of {what} in {name}, wrinkle {verb}, {many} {name}"
        shown = f"{value:.3g} {unit}"
        yield Row(f"{name}_{verb}_{what}", label, f"{some} {name}", float(exponent), 1.1, False, shown)


def density(places: Places) -> Iterator[Row]:
    """A bake of a mesh that is sixteen times as fine outside the patch."""
    folder, asset = places.folder, places.assets / "hand.glb"
    if not found(asset):
        return
    centre = np.array([-0.473, 0.2465, 0.1938])
    dense = finer(asset, folder / "dense.glb", keep=(centre, 0.06), rounds=2)
    tools = written(folder / "hand.yaml", HAND)
    copy = (
        "import sys; from wrinklecli.gltf.document import read_document\n"
        "from wrinklecli.gltf.edited_document import EditedDocument; from wrinklecli.gltf.writer import write\n"
        "write(EditedDocument(read_document(sys.argv[1])), sys.argv[2])"
    )
    fine, copied = timed(
        lambda: bake(dense, tools, folder / "out.glb"), lambda: run(dense, folder / "copy.glb", code=copy), repeats=7
    )
    what, over = "baking hand.glb with 16 times the triangles outside the patch", "reading and writing it"
    yield Row("density", what, over, fine / copied, 1.5, False, f"{fine:.2f} s")


def ways(places: Places) -> Iterator[Row]:
    """What a bake of many clips takes for its proof and its report, and a diff after a change of bumps."""
    folder, samples, configs = places.folder, ROOT / "samples", ROOT / "configs"
    clips, tools, out = (
        more_clips(samples / "wrist.glb", folder / "clips.glb", 24),
        configs / "wrist.yaml",
        folder / "o.glb",
    )
    plain, draft, reported = timed(
        lambda: bake(clips, tools, out),
        lambda: bake(clips, tools, out, "--draft"),
        lambda: bake(clips, tools, out, "--report", str(folder / "r.json")),
        repeats=3,
    )
    yield Row("proof_clips", "baking 24 clips", "a draft", plain / draft, 3, False, f"{plain:.2f} s")
    yield Row(
        "report_clips", "baking 24 clips with a report", "without", reported / plain, 3, False, f"{reported:.2f} s"
    )
    fewer = folder / "fewer.yaml"
    fewer.write_text((configs / "head.yaml").read_text().replace("bumps: 5", "bumps: 3"))
    bake(samples / "head.glb", fewer, folder / "fewer.glb")
    compare = "import sys; from wrinklecli.review.diff.diff import diff; diff(sys.argv[1], sys.argv[2])"
    baking, comparing = timed(
        lambda: bake(samples / "head.glb", configs / "head.yaml", out),
        lambda: run(out, folder / "fewer.glb", code=compare),
        repeats=3,
    )
    what = "diff of head.glb with five and with three bumps"
    yield Row("diff_bumps", what, "a bake of it", comparing / baking, 3, False, f"{comparing:.2f} s")


HAND = "{name: wrist, origin: [-0.4622, 0.2576, 0.1750], target: [-0.4838, 0.2355, 0.2126], width: 0.05, bumps: 4}"
# The knees of configs/trousers.yaml, of the one wave that both programs make.
KNEES = (
    "{name: knee.L, origin: [0.104, 0.635, -0.0906], target: [0.104, 0.365, -0.0844], mirror: x, width: 0.24, bumps: 6}"
)


def found(asset: Path) -> bool:
    """Whether an asset is there; else says that its rows are left out."""
    if not asset.is_file():
        print(f"no {asset.name} in --assets: its rows are left out", file=sys.stderr)
    return asset.is_file()


def written(path: Path, tool: str) -> Path:
    """Write a file of one tool."""
    path.write_text(f"version: 1\ntools:\n  - {tool}\n", encoding="utf-8")
    return path


def start(places: Places) -> Iterator[Row]:
    """Short commands, over a Python that imports numpy."""
    folder, asset = places.folder, places.assets / "simple_skin.gltf"
    over = "python importing numpy"
    short, importing = timed(lambda: run("--help", code=WRINKLE), lambda: run(code="import numpy"), repeats=11)
    yield Row("help", "wrinkle --help", over, short / importing, 1.0, False, f"{short:.2f} s")
    if not found(asset):
        return
    bend = "{name: bend, origin: [-0.4, 0.6, 0.0], target: [-0.4, 1.4, 0.0], width: 0.8, bumps: 2}"
    tools = written(folder / "bend.yaml", bend)
    baking, importing = timed(
        lambda: bake(asset, tools, folder / "out.glb"), lambda: run(code="import numpy"), repeats=11
    )
    yield Row("simple_skin", "baking simple_skin.gltf", over, baking / importing, 4.0, False, f"{baking:.2f} s")


def edits(places: Places) -> Iterator[Row]:
    """What a hand feels in `wrinkle edit`: what is dragged and let go, and a frame of a playing clip."""
    from editor import cases, felt

    assets = cases(places.folder)
    if found(asset := places.assets / "trousers.glb"):
        assets.append((asset, places.folder / "theirs.yaml"))
    for asset, tools in assets:
        each = felt(asset, tools)
        what = f"{tools.stem} of {each.triangles:,} triangles"
        dragged = max(each.clock[job] for job in ("width", "end", "bumps"))
        for name, said, seconds, reach in (
            ("frame", f"a frame of {what}", each.clock["frame"], 0.05),
            ("drag", f"a drag on {what}", dragged, 0.1),
            ("full", f"letting go of it, {what}", each.clock["refined"], 2.0),
        ):
            over, shown = f"{reach:g} s", f"{1000 * seconds:.0f} ms"
            yield Row(f"edit_{name}_{tools.stem}", said, over, seconds / reach, 1.0, False, shown)


def batches(places: Places, count: int = 1000, alone: int = 25) -> Iterator[Row]:
    """Many small assets in one command: over one by one, over two workers, and with nothing to do.

    What two workers could reach is what two processes do that share nothing: two cores slow each other down.
    """
    folder = places.folder / "batch"
    (folder / "chars").mkdir(parents=True)
    for number in range(count):
        limb_asset(rings=7, sides=6, angle=30 + 0.1 * number).write(folder / "chars" / f"{number}.glb")
    tools = write_tools(folder / "tools.yaml", limb_tool(bumps=2))

    def batch(out: str, workers: int = 1, which: str = "*") -> float:
        asked = ("--tools", tools, "--out", folder / out / "{stem}.glb", "--cache", folder / f"{out}.cache", "-q")
        return run("batch", folder / "chars" / f"{which}.glb", *asked, "-j", str(workers), code=WRINKLE)

    one, two = batch("one"), batch("two", 2)
    again = batch("one")
    start = time.perf_counter()
    with ThreadPoolExecutor() as both:
        list(both.map(batch, ("even", "odd"), (1, 1), ("*[02468]", "*[13579]")))
    apart = time.perf_counter() - start
    single = [bake(folder / "chars" / f"{number}.glb", tools, folder / "out.glb") for number in range(alone)]
    each = count * statistics.median(single)
    what = f"{count:,} small assets"
    yield Row("batch_loop", f"{what}, one bake after another", "batch", each / one, 3.0, True, f"{one:.1f} s")
    yield Row("batch_workers", f"{what} by one worker", "two workers", one / two, 1.8, True, f"{two:.1f} s")
    over = "two processes of one worker with half of them each"
    yield Row("batch_shared", f"{what} by two workers", over, two / apart, 1.1, False, f"{two:.1f} s")
    yield Row("batch_again", f"{what}, nothing to do", "the first run", again / one, 0.02, False, f"{again:.2f} s")


def blender(places: Places) -> Iterator[Row]:
    """A shape key for each frame, made by Blender."""
    if places.blender is None:
        print("no bpy (tests/benchmarks/blender.sh installs it): Blender's rows are left out", file=sys.stderr)
        return
    hand = places.assets / "hand.glb"
    if found(hand):
        yield from shape_keys(places, "hand", hand, HAND, "bend", (6, 100))
    yield from shape_keys(places, "character", two_knees(places), KNEES, "squat", (45, 500))


def two_knees(places: Places) -> Path:
    """A character of 26,762 triangles: the first 61 frames, of 73, of a squat.

    The waist stands for the rest, which no tool touches: each of its triangles is split in 16, and legs and knees stay
    as they are.
    """
    squat = longer(ROOT / "samples" / "trousers.glb", places.folder / "squat.glb", 60 / FPS)
    return finer(squat, places.folder / "character.glb", keep=(np.array([0.0, 0.5, 0.0]), 0.3847), rounds=2)


def drawn(places: Places) -> Iterator[Row]:
    """A frame of meshes in parts over that of whole ones, in three.js, drawn without a GPU."""
    if shutil.which("chromium") is None:
        print("no chromium: rows of what is drawn are left out", file=sys.stderr)
        return
    from drawn import frame_times

    head = ROOT / "samples" / "head.glb", ROOT / "configs" / "head.yaml", "raise_brows"
    knees = two_knees(places), written(places.folder / "knees.yaml", KNEES), "squat"
    for name, (asset, tools, clip) in {"head": head, "character": knees}.items():
        whole, parts = (places.folder / f"{name}_{each}.glb" for each in ("whole", "parts"))
        bake(asset, tools, whole)
        bake(asset, tools, parts, "--split")
        one, many, bare = frame_times([whole, parts, asset], clip)
        shown = f"{many:.0f} over {one:.0f} ms; without wrinkles {bare:.0f} ms"
        what = f"a frame of the {name} in parts, {triangles(asset):,} triangles, three.js without a GPU"
        yield Row(f"drawn_{name}", what, "the same as a whole", many / one, 1.0, False, shown)


def shape_keys(
    places: Places, name: str, asset: Path, tool: str, clip: str, reaches: tuple[float, float]
) -> Iterator[Row]:
    """Time and bytes of Blender over those of a bake: the quick way, then an artist's."""
    tools, segments = written(places.folder / f"{name}.yaml", tool), places.folder / f"{name}.json"
    baked, keyed = places.folder / f"{name}_baked.glb", places.folder / f"{name}_keyed.glb"
    each = [(list(a.origin), list(a.target), a.width.value, a.bumps) for a in load_tools(tools).tools]
    segments.write_text(json.dumps([dict(zip(("origin", "target", "width", "bumps"), a, strict=True)) for a in each]))
    script = [HERE / "blender_keyshapes.py", asset, segments, keyed, "--clip", clip, "--fps", str(FPS)]
    label = f"{name} of {triangles(asset):,} triangles, 61 frames of {clip}"
    ways = (
        ("", "products of arrays, the patches subdivided", [], 5),
        ("_operators", "its own tools, the whole mesh subdivided", ["--operators"], 3),
    )
    for suffix, means, options, repeats in ways:
        theirs, ours = timed(
            lambda options=options: run(*script, *options, blender=places.blender),
            lambda: bake(asset, tools, baked, "--clip", clip, "--max-levels", "1"),
            repeats=repeats,
        )
        assert_alike(keyed, baked, clip, 61)
        way = f"for {label}, a shape key each by {means}"
        shown = f"{theirs:.2f} s over {ours:.2f} s"
        what, ratio = f"Blender's time {way}", theirs / ours
        yield Row(f"blender_{name}_time{suffix}", what, "the bake's", ratio, reaches[0], True, shown)
        more, less = (path.stat().st_size - asset.stat().st_size for path in (keyed, baked))
        shown = f"{more / 1e3:,.0f} kB over {less / 1e3:,.1f} kB"
        what, ratio = f"bytes that Blender adds {way}", more / less
        yield Row(f"blender_{name}_bytes{suffix}", what, "the bake's", ratio, reaches[1], True, shown)


def triangles(asset: Path) -> int:
    """Of an asset's first mesh."""
    document = read_document(asset)
    total = 0
    for number, primitive in enumerate(document.items("meshes")[0]["primitives"]):
        count = len(document.accessor(primitive["attributes"]["POSITION"]))
        total += len(read_triangles(document, primitive, count, document.where("meshes", 0, "primitives", number)))
    return total


def played(path: Path, clip: str) -> tuple[list[Floats], Floats]:
    """Morph targets (vertices, 3) of a file's one mesh, and their weights (keys, targets) in a clip."""
    document = read_document(path)
    ((primitive,),) = (mesh["primitives"] for mesh in document.items("meshes"))
    targets = [document.accessor(target["POSITION"]).astype(np.float64) for target in primitive["targets"]]
    (animation,) = (each for each in document.items("animations") if each["name"] == clip)
    (channel,) = (each for each in animation["channels"] if each["target"]["path"] == "weights")
    weights = document.accessor(animation["samplers"][channel["sampler"]]["output"]).reshape(-1, len(targets))
    return targets, weights.astype(np.float64)


def assert_alike(keyed: Path, baked: Path, clip: str, count: int) -> None:
    """Blender's file has a target for each frame, on in it and off elsewhere, and wrinkles as tall as the bake's."""
    targets, weights = played(keyed, clip)
    assert np.array_equal(weights, np.eye(count)), f"{keyed}: not one shape key a frame"
    theirs, ours = tallest(targets, weights), tallest(*played(baked, clip))
    # Blender measures between vertices, and at frames only.
    assert abs(theirs - ours) < 0.1 * ours, f"{keyed}: wrinkles of {theirs:.3g}, {baked}: of {ours:.3g}"


def tallest(targets: list[Floats], weights: Floats) -> float:
    """The greatest displacement at any key."""
    moved = (sum(row[k] * targets[k] for k in np.nonzero(row)[0]) for row in weights if row.any())
    return max(float(np.linalg.norm(each, axis=-1).max()) for each in moved)


def contact(places: Places) -> Iterator[Row]:
    """Folds that touch, one in each bake: what is left of their crossings, what they cost, what becomes of volume."""
    crease = limb_tool(bumps=3, max_height="8%", node="limb")
    limb = limb_asset(rings=30, sides=20, angle=85).write(places.folder / "limb.glb")
    yield from folded(places, "elbow", limb, {"version": 1, "tools": [crease]})
    waving = waving_limb(20, rings=30, sides=20).write(places.folder / "waving.glb")
    yield from folded(places, "elbow off its axis", waving, {"version": 1, "tools": [crease], "sampling": {"fps": 15}})
    sleeved = sleeved_limb(gap=0.05, rings=24, sides=16, angle=45).write(places.folder / "sleeved.glb")
    yield from folded(places, "sleeve", sleeved, {"version": 1, "tools": [crease]}, parts="limb: ")
    nosed = nose().write(places.folder / "nose.glb")
    bridge = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
    yield from folded(places, "nose", nosed, {"version": 1, "tools": [bridge]}, parts="glasses")
    samples = yaml.safe_load((ROOT / "configs" / "trousers.yaml").read_text(encoding="utf-8"))
    knee = {"only": ("knee.L",), "clips": ("squat",), "max_levels": 2}
    yield from folded(places, "knee", ROOT / "samples" / "trousers.glb", samples, **knee)
    if found(places.assets / "hand.glb"):
        place: dict[str, Any] = {"origin": [-0.4622, 0.2576, 0.1750], "target": [-0.4838, 0.2355, 0.2126]}
        wrist = {"name": "wrist", **place, "width": 0.05, "bumps": 4}
        yield from folded(places, "hand", places.assets / "hand.glb", {"version": 1, "tools": [wrist]}, clips=("bend",))


def folded(
    places: Places, name: str, asset: Path, tools: dict[str, Any], *, parts: str = "", **options: Any
) -> Iterator[Row]:
    """The one fold of a bake, with contact and without.

    Args:
        places: Of the benchmarks.
        name: For the rows.
        asset: With the fold.
        tools: Over it.
        parts: What crosses with or through something of that name counts; left out, what crosses at the joint.
        options: Of the bakes.
    """
    seconds, crossing, fold = [], [], {}
    for wanted in ("resolve", "off"):
        each = {**tools, "defaults": {**tools.get("defaults", {}), "contact": wanted}}
        stem = name.replace(" ", "_")
        path, out = places.folder / f"{stem}_{wanted}.yaml", places.folder / f"{stem}_{wanted}.glb"
        path.write_text(json.dumps(each), encoding="utf-8")
        begun = time.process_time()
        report = wrinklecli.bake(asset, path, out, **options)
        seconds.append(time.process_time() - begun)
        (fold,) = report.data["folds"] if wanted == "resolve" else [fold]
        # Elsewhere a mesh, or the sleeve, may cross itself as ever.
        clips = crossings(out, clips=options.get("clips", ())).data["clips"]
        here = [
            part["counts"] for clip in clips for part in clip["places"] if (parts or fold["joint"]) in part["between"]
        ]
        crossing.append((sum(before for before, _ in here), sum(after for _, after in here)))
    (before, left), (_, without) = crossing
    what, over = f"crossings in a fold that touches, {name}", "those without contact"
    yield Row(f"contact_left_{name}", what, over, left / without, 0.05, False, f"{before} -> {without} -> {left}")
    spent = seconds[0] - seconds[1]
    what = f"seconds that contact takes in a fold and its clips, {name}"
    yield Row(f"contact_seconds_{name}", what, "10", spent / 10, 1.0, False, f"{spent:.1f} s")
    targets = len(fold["targets"])
    what = f"morph targets of a fold that touches, {name}"
    yield Row(f"contact_targets_{name}", what, "the 8 that it may have", targets / 8, 1.0, False, f"{targets}")
    lost = 100.0 * fold["volume_lost"]
    what = f"volume that a fold loses, {name}"
    yield Row(f"contact_volume_{name}", what, "1 % of the limb beside it", lost, 1.0, False, f"{lost:.2f} %")


SECTIONS = {
    each.__name__: each
    for each in (frames, rates, growth, scaling, density, ways, start, edits, batches, drawn, blender, contact)
}


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=SECTIONS, help="may be repeated")
    parser.add_argument("--release", help="append a row of this name to results.csv")
    parser.add_argument("--assets", type=Path, default=ROOT.parent / "shared" / "assets")
    parser.add_argument("--bpy", type=Path, default=ROOT / ".bpy", help="what blender.sh made")
    parser.add_argument("--markdown", action="store_true", help="the table on stdout; its rows meanwhile on stderr")
    options = parser.parse_args()
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    print(f"load average {load:.2f}, {cores} cores", file=sys.stderr)
    if load > 0.5 * cores:
        print("warning: others are at work on this machine, which disturbs the ratios", file=sys.stderr)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        places = Places(Path(folder), options.assets, with_bpy(options.bpy))
        for name in options.only or SECTIONS:
            for row in SECTIONS[name](places):
                rows.append(row)
                print(row, file=sys.stderr if options.markdown else sys.stdout, flush=True)
    if options.markdown:
        print(markdown(rows))
    if options.release:
        record(options.release, rows)
    return 0 if all(row.held for row in rows) else 1


def with_bpy(folder: Path) -> str | None:
    """A Python that can import bpy: that of an environment, else this one."""
    own = folder.resolve() / "bin" / "python"
    if own.is_file():
        return str(own)
    return sys.executable if importlib.util.find_spec("bpy") else None


def markdown(rows: list[Row]) -> str:
    """A table of rows."""
    lines = ["| | over | ratio | to reach | measured |", "|---|---|---|---|---|"]
    for row in rows:
        ratio = f"{row.ratio:.3g}" if row.held else f"**{row.ratio:.3g}**, missed"
        lines.append(f"| {row.what} | {row.over} | {ratio} | {row.wanted} | {row.shown} |")
    return "\n".join(lines)


def record(release: str, rows: list[Row]) -> None:
    """Append a row of ratios to results.csv; columns are only added."""
    path = HERE / "results.csv"
    old = list(csv.DictReader(path.open())) if path.exists() else []
    entry = {
        "release": release,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
    }
    entry |= {row.name: f"{row.ratio:.3g}" for row in rows}
    names = list(dict.fromkeys([*(old[0] if old else ()), *entry]))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows([*old, entry])


if __name__ == "__main__":
    sys.exit(main())
