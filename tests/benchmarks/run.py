"""Measures what baking costs, each time as a ratio to something else in the same run on the same machine.

    python tests/benchmarks/run.py                          all rows, a line for each
    python tests/benchmarks/run.py --only frames --only start  those of some sections
    python tests/benchmarks/run.py --release 0.2.0          also as a row of results.csv and of README.md here
    python tests/benchmarks/run.py --assets DIR             with hand.glb and simple_skin.gltf from there
    python tests/benchmarks/run.py --markdown               the table as Markdown, on stdout
    python tests/benchmarks/run.py --readme                 that table anew from results.csv; nothing is run
    python tests/benchmarks/run.py --tiny                   as little as runs each line, once: are the sections right?

The rows of Blender need `bpy` in an environment of its own, which tests/benchmarks/blender.sh makes. There Blender runs
blender_keyshapes.py, with as many threads as it likes. All else is medians of several runs with one thread, which take
turns with the runs that they are compared with. `rows.py` has the goals.

The paper's figures: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on a 1.7 GHz PC.
"""

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

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
from rows import Row, markdown, readme_table, record, recorded, write_readme  # noqa: E402

from kit.crowd import write_crowds, write_frames  # noqa: E402
from kit.limb import limb_asset, write_tools  # noqa: E402
from kit.limb import tool as limb_tool  # noqa: E402
from kit.tube import write_tube  # noqa: E402
from wrinklecli.character.clip import Clip, read_clips  # noqa: E402
from wrinklecli.character.pose import joint_matrices, morph_weights  # noqa: E402
from wrinklecli.character.skin import Influences, pose, prepare  # noqa: E402
from wrinklecli.character.surface import read_triangles  # noqa: E402
from wrinklecli.drive.play import Playing  # noqa: E402
from wrinklecli.effects.effect import MeshPlan  # noqa: E402
from wrinklecli.effects.plan import plan_mesh  # noqa: E402
from wrinklecli.effects.wrinkle.activity import curve_drive  # noqa: E402
from wrinklecli.effects.wrinkle.bending import rising  # noqa: E402
from wrinklecli.effects.wrinkle.effect import shapes_of  # noqa: E402
from wrinklecli.effects.wrinkle.layer import carried_patches_of  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.tools.read import load_tools  # noqa: E402
from wrinklecli.tools.records import Length  # noqa: E402

Floats = NDArray[np.float64]
Command = tuple[str | Path, ...]

FPS = 30
Three = tuple[int, int, int]


@dataclass(frozen=True)
class Sizes:
    """Sizes of what is measured.

    Attributes:
        workloads: Sample, levels, and the paper's frames per second.
        frames: Frames that are posed at once.
        longer: Frames by which a clip is longer: what they cost is to stand out from how unevenly processes start.
        most_repeats: Runs of which the median is taken, at most.
        growth: Few, some and many frames of a clip.
        tools, instances, shown: Few, some and many of them; a bake shows its frames one after another. Instances are so
            many that they take the memory, and not the code that draws them.
        clips: Clips of one asset.
        edits: Times that something is dragged in the editor.
        small_assets: Assets of one batch, and
        alone: how many of them are baked one by one.
        folds: Names of the folds with contact.
        drawn: Frames that three.js draws.
        picture, levels: Options that make pictures, and bakes of samples, smaller.
    """

    workloads: Sequence[tuple[str, int, float]]
    frames: int
    longer: int
    most_repeats: int
    growth: Three
    tools: Three
    instances: Three
    shown: Three
    clips: int
    edits: int
    small_assets: int
    alone: int
    folds: Sequence[str]
    drawn: int
    picture: tuple[str, ...] = ()
    levels: tuple[str, ...] = ()


FULL = Sizes(
    workloads=(("head", 1, 13.0), ("head", 2, 3.6), ("wrist", 0, 188.0), ("wrist", 2, 23.0), ("trousers", 1, 17.0)),
    frames=250,
    longer=50_000,
    most_repeats=11,
    growth=(100, 1000, 10_000),
    tools=(5, 100, 400),
    instances=(400, 1600, 6400),
    shown=(10, 200, 800),
    clips=24,
    edits=20,
    small_assets=1000,
    alone=25,
    folds=("elbow", "elbow_off_axis", "sleeve", "nose", "knee", "hand"),
    drawn=60,
)
# Counts that are the same run once.
TINY = Sizes(
    workloads=(("wrist", 0, 188.0), ("trousers", 0, 17.0)),
    frames=4,
    longer=60,
    most_repeats=1,
    growth=(10, 20, 20),
    tools=(2, 2, 2),
    instances=(4, 4, 4),
    shown=(3, 3, 3),
    clips=2,
    edits=1,
    small_assets=4,
    alone=1,
    folds=("nose",),
    drawn=2,
    picture=("--size", "64x48"),
    levels=("--max-levels", "0"),
)


@dataclass(frozen=True)
class Subject:
    """An asset with a tool and a clip.

    Attributes:
        asset: The file.
        tool: One tool, as YAML.
        clip: A clip that shortens it.
        keep: Centre and radius, bind space, of the surface around the tool.
    """

    asset: Path
    tool: str
    clip: str
    keep: tuple[Floats, float]


@dataclass(frozen=True)
class Places:
    """Places of files, and sizes of what is measured.

    Attributes:
        folder: For the files that are made.
        assets: Assets that the project does not have; None takes its own in their place.
        blender: A Python that can import bpy, if there is one.
        sizes: How much is measured.
    """

    folder: Path
    assets: Path | None
    blender: str | None
    sizes: Sizes = FULL

    def repeats(self, most: int) -> int:
        """The number of runs of which a median is taken."""
        return min(most, self.sizes.most_repeats)

    def hand(self) -> Subject | None:
        """A real hand, if it is there; the sample wrist in place of it."""
        if self.assets is None:
            return Subject(ROOT / "samples" / "wrist.glb", PALM, "flex", (np.zeros(3), 0.06))
        hand = Subject(self.assets / "hand.glb", HAND, "bend", (np.array([-0.473, 0.2465, 0.1938]), 0.06))
        return hand if found(hand.asset) else None

    def few_vertices(self) -> Subject | None:
        """Ten vertices, if they are there; a small limb in place of them."""
        nowhere = np.zeros(3), 0.0
        if self.assets is None:
            limb = limb_asset(rings=7, sides=6).write(self.folder / "limb.glb")
            return Subject(limb, json.dumps(limb_tool(bumps=2)), "bend", nowhere)
        bend = "{name: bend, origin: [-0.4, 0.6, 0.0], target: [-0.4, 1.4, 0.0], width: 0.8, bumps: 2}"
        skin = Subject(self.assets / "simple_skin.gltf", bend, "", nowhere)
        return skin if found(skin.asset) else None


def timed(*jobs: Callable[[], object], repeats: int) -> list[float]:
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
    _output(arguments, _unlimited if blender else None)
    return time.perf_counter() - start


def _output(arguments: list[str], environment: dict[str, str] | None = None) -> str:
    """The standard output of a process.

    Raises:
        RuntimeError: It fails; with the end of what it said.
    """
    done = subprocess.run(arguments, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)}: exit code {done.returncode}: {done.stderr.strip()[-2000:]}")
    return done.stdout


# A process counts what its parent held when it began, so the parent must be small: not this one, but one between.
WATCH = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:])
if done.returncode:
    sys.exit(done.returncode)
taken = resource.getrusage(resource.RUSAGE_CHILDREN)
print(taken.ru_utime + taken.ru_stime, taken.ru_maxrss)
"""


def watched(*command: str | Path, code: str) -> tuple[float, float]:
    """Processor seconds, and greatest memory in MB (Linux counts in KB), of a process of this Python."""
    arguments = [sys.executable, "-S", "-c", WATCH, sys.executable, "-c", code, *map(str, command)]
    seconds, peak = _output(arguments).split()[-2:]
    return float(seconds), float(peak) / 1024


WRINKLE = "from wrinklecli.__main__ import main; main()"


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


def one_clip(places: Places, sample: str) -> Path:
    """Write a sample's tools file for an asset that has its first clip alone: it names no clip."""
    settings = yaml.safe_load((ROOT / "configs" / f"{sample}.yaml").read_text(encoding="utf-8"))
    for keys in (*settings["tools"], settings.get("defaults", {})):
        keys.pop("clips", None)
    path = places.folder / f"{sample}_one_clip.yaml"
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def frames(places: Places) -> Iterator[Row]:
    """Posed and wrinkled positions and normals of all members, in process."""
    for workload in places.sizes.workloads:
        yield from finished(places, *workload)


def finished(places: Places, sample: str, levels: int, paper: float) -> Iterator[Row]:
    """The frames of one workload."""
    count = places.sizes.frames
    plan, clip = planned(sample, levels)
    rig, fine = plan.rig, plan.fine
    patches = [each.patch for each in carried_patches_of(plan)]
    members = np.unique(np.concatenate([each.vertices for each in carried_patches_of(plan)]))
    weights, positions = fine.dense_weights(members, len(rig.joints)), fine.positions[members]
    every = [
        shape
        for each in carried_patches_of(plan)
        for shape in shapes_of(each, fine, rising(each.patch, plan.rig, plan.rest))
    ]
    shown = [shape is not None for shape in every]
    shapes = [shape for shape in every if shape is not None]
    old = fine.morph_deltas[:, members]
    deltas = np.array([spread(each.vertices, each.deltas, members) for each in shapes])
    turns = np.array([spread(each.normal_vertices, each.normal_deltas, members) for each in shapes])
    skin = prepare(
        Influences.of(weights),
        positions,
        np.concatenate([old, deltas]),
        fine.normals[members],
        np.concatenate([np.zeros_like(old), turns]),
    )
    times = np.linspace(clip.start, clip.end, count)
    tools = Playing([curve_drive(each) for each in patches], rig, clip)

    def heights() -> Floats:
        return np.concatenate([morph_weights(rig, clip, times), tools.at(times)[:, shown]], axis=1)

    known, played = joint_matrices(rig, clip, times), heights()
    homogeneous = np.concatenate([positions, np.ones((len(members), 1))], axis=1)

    def floor() -> None:
        rows = known[:, :, :3].transpose(1, 0, 2, 3).reshape(known.shape[1], -1)
        np.matmul((weights @ rows).reshape(len(weights), -1, 4), homogeneous[:, :, None])

    whole, finishing, least = timed(
        lambda: pose(skin, joint_matrices(rig, clip, times), heights()),
        lambda: pose(skin, known, played),
        floor,
        repeats=places.repeats(9),
    )
    label = f"{sample}, max_levels {levels}, {len(members)} members"
    rate = count / whole
    what, over = f"finished frames a second, {label}", f"the paper's {paper:g}"
    yield Row(f"frames_{sample}_{levels}", what, over, rate / paper, f"{rate:,.0f}/s")
    what, over = f"time to pose and wrinkle, {label}", "skinning positions alone"
    each = f"{1e9 * finishing / count / len(members):.0f} ns per vertex"
    yield Row(f"floor_{sample}_{levels}", what, over, finishing / least, each)


def spread(vertices: NDArray[np.intp], values: Floats, members: NDArray[np.intp]) -> Floats:
    """(members, 3) of values of some vertices, 0 elsewhere."""
    dense = np.zeros((int(max(members.max(), vertices.max(initial=0))) + 1, 3))
    dense[vertices] = values
    return dense[members]


def rates(places: Places) -> Iterator[Row]:
    """The cost of a longer clip beyond that of a short one."""
    for sample, levels, paper in places.sizes.workloads:
        rate = places.sizes.longer / longer_costs(places, sample, levels)
        what = f"frames of a longer clip that a bake takes a second, {sample}, max_levels {levels}"
        yield Row(f"bake_{sample}_{levels}", what, f"the paper's {paper:g}", rate / paper, f"{rate:,.0f}/s")


def longer_costs(places: Places, sample: str, levels: int) -> float:
    """Seconds that a clip takes more if it is longer."""
    folder, asset, tools = places.folder, ROOT / "samples" / f"{sample}.glb", one_clip(places, sample)
    short = longer(asset, folder / f"{sample}_short.glb", 100 / FPS)
    long = longer(asset, folder / f"{sample}_long.glb", (places.sizes.longer + 100) / FPS)

    def job(clip: Path) -> None:
        bake(clip, tools, folder / "out.glb", "--max-levels", str(levels))

    brief, extended = timed(lambda: job(short), lambda: job(long), repeats=places.repeats(7))
    return extended - brief


def growth(places: Places) -> Iterator[Row]:
    """Bytes, memory and time of long clips."""
    folder, (few, some, many) = places.folder, places.sizes.growth
    tools, asset = one_clip(places, "trousers"), ROOT / "samples" / "trousers.glb"
    clips = {count: longer(asset, folder / f"trousers_{count}.glb", count / FPS) for count in (few, some, many)}
    added, tracks = {}, {}
    # A .glb holds 4 GiB, and 10,000 frames of the refined mesh take more.
    for mode, counts, options in (
        ("morph", sorted({few, some, many}), ()),
        ("frames", [few, many], ("--max-levels", "0")),
    ):
        peaks, seconds = {}, {}
        for count in counts:
            out = folder / f"{mode}_{count}.glb"
            command: Command = ("bake", clips[count], tools, "-o", out, "-q", "--mode", mode, *options)
            runs = [watched(*command, code=WRINKLE) for _ in range(places.repeats(3))]
            peaks[count] = statistics.median(peak for _, peak in runs)
            seconds[count] = statistics.median(each for each, _ in runs)
            if mode == "morph":
                added[count], tracks[count] = out.stat().st_size - clips[count].stat().st_size, track_bytes(out)
            out.unlink()
        what, over = f"trousers, --mode {mode}, {many:,} frames", f"{few:,} frames"
        yield Row(f"memory_{mode}", f"peak memory, {what}", over, peaks[many] / peaks[few], f"{peaks[many]:.0f} MB")
        pace, before = (seconds[count] / count for count in (many, few))
        yield Row(f"pace_{mode}", f"time per frame, {what}", over, pace / before, f"{1e3 * pace:.2f} ms")
    fewer = few if some == many else some
    grown = added[many] - added[fewer]
    what, over = "bytes that ten times the frames add, trousers", "those that they add to the weight tracks"
    yield Row("bytes", what, over, grown / (tracks[many] - tracks[fewer]), f"{grown / 1e3:,.0f} kB")


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
    """Exponents by which time and memory grow with the tools, instances and frames of a file, beyond those of few."""
    folder = places.folder
    picture = ("-o", folder / "many.png", "-q", *places.sizes.picture)

    def baked(count: int) -> Command:
        return "bake", *write_tube(folder, count), "-q", "-o", folder / "tube.glb"

    for name, command in (
        ("tools", baked),
        ("tools", lambda count: ("check", *write_tube(folder, count))),
        ("instances", lambda count: ("diff", *write_crowds(folder, count))),
        ("instances", lambda count: ("preview", write_crowds(folder, count)[0], *picture)),
        ("shown", lambda count: ("diff", *write_frames(folder, count))),
        ("shown", lambda count: ("preview", write_frames(folder, count)[0], *picture)),
    ):
        yield from grown(places, name, command)


def grown(places: Places, name: str, command: Callable[[int], Command]) -> Iterator[Row]:
    """The exponents of a command's time and memory, from few, some and many of a thing."""
    counts: Three = getattr(places.sizes, name)
    few, some, many = counts
    commands = {count: command(count) for count in counts}
    # In turns, so that what else the machine does disturbs all of them.
    runs = [[watched(*each, code=WRINKLE) for each in commands.values()] for _ in range(places.repeats(3))]
    taken = dict(zip(commands, np.median(runs, axis=0), strict=True))
    with np.errstate(all="ignore"):  # where all are the same, or the fewest take no longer than nothing
        ratios = (taken[many] - taken[few]) / (taken[some] - taken[few])
        exponents = np.log(ratios) / np.log(np.float64(many - few) / (some - few))
    verb, things = commands[many][0], {"shown": "frames"}.get(name, name)
    for what, exponent, unit, value in zip(("time", "memory"), exponents, ("s", "MB"), taken[many], strict=True):
        label = f"exponent of {what} in {things}, wrinkle {verb}, {many} {things}"
        shown = f"{value:.3g} {unit}"
        yield Row(f"exponent_{things}_{verb}_{what}", label, f"{some} {things}", float(exponent), shown)


def density(places: Places) -> Iterator[Row]:
    """A bake of a mesh that is sixteen times as fine outside the patch."""
    folder, hand = places.folder, places.hand()
    if hand is None:
        return
    dense, tools = finer(hand.asset, folder / "dense.glb", keep=hand.keep, rounds=2), written(folder, "hand", hand.tool)
    copy = (
        "import sys; from wrinklecli.gltf.document import read_document\n"
        "from wrinklecli.gltf.edited_document import EditedDocument; from wrinklecli.gltf.writer import write\n"
        "write(EditedDocument(read_document(sys.argv[1])), sys.argv[2])"
    )
    fine, copied = timed(
        lambda: bake(dense, tools, folder / "out.glb"),
        lambda: run(dense, folder / "copy.glb", code=copy),
        repeats=places.repeats(7),
    )
    what, over = f"baking {hand.asset.name} with 16 times the triangles outside the patch", "reading and writing it"
    yield Row("density", what, over, fine / copied, f"{fine:.2f} s")


def ways(places: Places) -> Iterator[Row]:
    """The proof and the report of a bake of many clips, and a diff after a change of bumps."""
    folder, samples, configs, count = places.folder, ROOT / "samples", ROOT / "configs", places.sizes.clips
    clips = more_clips(samples / "wrist.glb", folder / "clips.glb", count)
    tools, out, levels = configs / "wrist.yaml", folder / "o.glb", places.sizes.levels
    plain, draft, reported = timed(
        lambda: bake(clips, tools, out, *levels),
        lambda: bake(clips, tools, out, *levels, "--draft"),
        lambda: bake(clips, tools, out, *levels, "--report", str(folder / "r.json")),
        repeats=places.repeats(3),
    )
    what = f"baking {count} clips"
    yield Row("proof_clips", what, "a draft", plain / draft, f"{plain:.2f} s")
    yield Row("report_clips", f"{what} with a report", "without", reported / plain, f"{reported:.2f} s")
    name = "wrist" if places.assets is None else "head"
    asset, tools, fewer = samples / f"{name}.glb", configs / f"{name}.yaml", folder / "fewer.yaml"
    fewer.write_text(tools.read_text(encoding="utf-8").replace("bumps: 5", "bumps: 3"), encoding="utf-8")
    bake(asset, fewer, folder / "fewer.glb", *levels)
    compare = "import sys; from wrinklecli.review.diff.diff import diff; diff(sys.argv[1], sys.argv[2])"
    baking, comparing = timed(
        lambda: bake(asset, tools, out, *levels),
        lambda: run(out, folder / "fewer.glb", code=compare),
        repeats=places.repeats(3),
    )
    what = f"diff of {name}.glb with five and with three bumps"
    yield Row("diff_bumps", what, "a bake of it", comparing / baking, f"{comparing:.2f} s")


HAND = "{name: wrist, origin: [-0.4622, 0.2576, 0.1750], target: [-0.4838, 0.2355, 0.2126], width: 0.05, bumps: 4}"
PALM = "{name: palm, origin: [-0.034, -0.0221, 0.0], target: [0.030, -0.0200, 0.0], width: 0.07, bumps: 4}"
# Knees of the sample trousers, of the one wave that both programs make.
KNEES = (
    "{name: knee.L, origin: [0.104, 0.635, -0.0906], target: [0.104, 0.365, -0.0844], mirror: x, width: 0.24, bumps: 6}"
)


def found(asset: Path) -> bool:
    """True if an asset is there; else says that its rows are left out."""
    if not asset.is_file():
        print(f"no {asset.name} in --assets: its rows are left out", file=sys.stderr)
    return asset.is_file()


def written(folder: Path, name: str, tool: str) -> Path:
    """Write a file of one tool."""
    path = folder / f"{name}.yaml"
    path.write_text(f"version: 1\ntools:\n  - {tool}\n", encoding="utf-8")
    return path


def start(places: Places) -> Iterator[Row]:
    """Short commands, over a Python that imports numpy."""
    over, repeats = "python importing numpy", places.repeats(11)
    few, knees = places.few_vertices(), two_knees(places)
    bakes = [("two_knees", knees, KNEES, ("--clip", "squat", "--max-levels", "1"))]
    bakes += [] if few is None else [("simple_skin", few.asset, few.tool, ())]
    ways = {"help": ("wrinkle --help", lambda: run("--help", code=WRINKLE))}
    for name, asset, tool, options in bakes:
        order = partial(bake, asset, written(places.folder, name, tool), places.folder / "out.glb", *options)
        ways[name] = (f"baking {asset.name}", order)
    for name, (what, order) in ways.items():
        took, importing = timed(order, lambda: run(code="import numpy"), repeats=repeats)
        yield Row(name, what, over, took / importing, f"{took:.2f} s")


def edits(places: Places) -> Iterator[Row]:
    """The times that a hand waits for in `wrinkle edit`: for a drag, for letting go, and for a frame of a clip."""
    from editor import cases, felt

    assets = cases(places.folder)
    if places.assets is None:
        assets = assets[-1:]
    elif found(asset := places.assets / "hand.glb"):
        assets.append((asset, places.folder / "theirs.yaml"))
    for asset, tools in assets:
        each = felt(asset, tools, places.sizes.edits)
        what = f"{tools.stem} of {each.triangles:,} triangles"
        dragged = max(each.clock[job] for job in ("width", "end", "bumps"))
        for name, said, seconds, reach in (
            ("frame", f"a frame of {what}", each.clock["frame"], 0.05),
            ("drag", f"a drag on {what}", dragged, 0.1),
            ("full", f"letting go of it, {what}", each.clock["refined"], 2.0),
        ):
            over, shown = f"{reach:g} s", f"{1000 * seconds:.0f} ms"
            yield Row(f"edit_{name}_{tools.stem}", said, over, seconds / reach, shown)


def flesh(places: Places) -> Iterator[Row]:
    """The times that a hand waits for with a region of flesh in `wrinkle edit`."""
    from editor import felt_flesh

    each = felt_flesh(places.folder, places.sizes.edits)
    what = f"flesh, {each.triangles:,} triangles"
    for name, said, job, reach in (
        ("frame", f"a frame of {what}", "frame", 0.05),
        ("drag", f"its frequency while it plays, {what}", "frequency", 0.05),
        ("again", f"a second bake with another frequency, {what}", "again", 1.0),
    ):
        seconds = each.clock[job]
        yield Row(f"edit_{name}_flesh", said, f"{reach:g} s", seconds / reach, f"{1000 * seconds:.0f} ms")


def batches(places: Places) -> Iterator[Row]:
    """Many small assets in one command: over one by one, over two workers, and with nothing to do.

    Two workers can reach as much as two processes that share nothing: two cores slow each other down.
    """
    folder, count = places.folder / "batch", places.sizes.small_assets
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
    single = [
        bake(folder / "chars" / f"{number}.glb", tools, folder / "out.glb") for number in range(places.sizes.alone)
    ]
    each = count * statistics.median(single)
    what = f"{count:,} small assets"
    yield Row("batch_loop", f"{what}, one bake after another", "batch", each / one, f"{one:.1f} s")
    yield Row("batch_workers", f"{what} by one worker", "two workers", one / two, f"{two:.1f} s")
    over = "two processes of one worker with half of them each"
    yield Row("batch_shared", f"{what} by two workers", over, two / apart, f"{two:.1f} s")
    yield Row("batch_again", f"{what}, nothing to do", "the first run", again / one, f"{again:.2f} s")


def blender(places: Places) -> Iterator[Row]:
    """A shape key for each frame, made by Blender."""
    if places.blender is None:
        print("no bpy (tests/benchmarks/blender.sh installs it): Blender's rows are left out", file=sys.stderr)
        if places.assets is not None:
            return
    hand = places.hand()
    if hand is not None:
        yield from shape_keys(places, "hand", hand.asset, hand.tool, hand.clip)
    if places.blender is not None:
        yield from shape_keys(places, "character", two_knees(places), KNEES, "squat")


def two_knees(places: Places) -> Path:
    """A character of 26,762 triangles: the first 61 frames, of 73, of a squat.

    The waist stands for the rest, which no tool touches: each of its triangles is split in 16, and legs and knees stay
    as they are.
    """
    squat = longer(ROOT / "samples" / "trousers.glb", places.folder / "squat.glb", 60 / FPS)
    return finer(squat, places.folder / "character.glb", keep=(np.array([0.0, 0.5, 0.0]), 0.3847), rounds=2)


def drawn(places: Places) -> Iterator[Row]:
    """A frame of meshes in parts over that of whole ones, in three.js, drawn without a GPU."""
    from drawn import frame_times, missing

    if lacking := missing():
        print(f"{lacking}: rows of frames that are drawn are left out", file=sys.stderr)
        return
    if places.assets is None:
        cases = {"wrist": (ROOT / "samples" / "wrist.glb", ROOT / "configs" / "wrist.yaml", "flex")}
    else:
        head = ROOT / "samples" / "head.glb", ROOT / "configs" / "head.yaml", "raise_brows"
        cases = {"head": head, "character": (two_knees(places), written(places.folder, "knees", KNEES), "squat")}
    for name, (asset, tools, clip) in cases.items():
        whole, parts = (places.folder / f"{name}_{each}.glb" for each in ("whole", "parts"))
        bake(asset, tools, whole, *places.sizes.levels)
        bake(asset, tools, parts, *places.sizes.levels, "--split")
        one, many, bare = frame_times([whole, parts, asset], clip, places.sizes.drawn)
        shown = f"{many:.0f} over {one:.0f} ms; without wrinkles {bare:.0f} ms"
        what = f"a frame of the {name} in parts, {triangles(asset):,} triangles, three.js without a GPU"
        yield Row(f"drawn_{name}", what, "the same as a whole", many / one, shown)


def shape_keys(places: Places, name: str, asset: Path, tool: str, clip: str) -> Iterator[Row]:
    """Time and bytes of Blender over those of a bake: the quick way, then an artist's.

    Without Blender there are no rows: its orders are written, and the bake is looked at.
    """
    tools, segments = written(places.folder, name, tool), places.folder / f"{name}.json"
    baked, keyed = places.folder / f"{name}_baked.glb", places.folder / f"{name}_keyed.glb"
    each = [(list(a.origin), list(a.target), a.width.value, a.bumps) for a in load_tools(tools).tools]
    segments.write_text(json.dumps([dict(zip(("origin", "target", "width", "bumps"), a, strict=True)) for a in each]))
    options = ("--clip", clip, "--max-levels", "1")
    if places.blender is None:
        bake(asset, tools, baked, *options)
        assert tallest(*played(baked, clip)) > 0.0, f"{baked}: nothing wrinkles"
        return
    script = [HERE / "blender_keyshapes.py", asset, segments, keyed, "--clip", clip, "--fps", str(FPS)]
    label = f"{name} of {triangles(asset):,} triangles, 61 frames of {clip}"
    ways = (
        ("", "products of arrays, the patches subdivided", [], 5),
        ("_operators", "its own tools, the whole mesh subdivided", ["--operators"], 3),
    )
    for suffix, means, way, repeats in ways:
        theirs, ours = timed(
            lambda way=way: run(*script, *way, blender=places.blender),
            lambda: bake(asset, tools, baked, *options),
            repeats=places.repeats(repeats),
        )
        assert_alike(keyed, baked, clip, 61)
        label_of_way = f"for {label}, a shape key each by {means}"
        shown = f"{theirs:.2f} s over {ours:.2f} s"
        yield Row(f"blender_{name}_time{suffix}", f"Blender's time {label_of_way}", "the bake's", theirs / ours, shown)
        more, less = (path.stat().st_size - asset.stat().st_size for path in (keyed, baked))
        shown = f"{more / 1e3:,.0f} kB over {less / 1e3:,.1f} kB"
        what = f"bytes that Blender adds {label_of_way}"
        yield Row(f"blender_{name}_bytes{suffix}", what, "the bake's", more / less, shown)


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
    """Folds that touch: what is left of their crossings, what they cost, what becomes of volume."""
    from contact_table import cases, compile_program, measured

    compile_program(ROOT)
    known = cases(places.assets)
    for name in places.sizes.folds:
        case = known.get(_FOLDS.get(name, name))
        if case is None or (isinstance(asset := case.asset(), Path) and not found(asset)):
            continue
        each = measured("", name, case, ROOT, places.folder)
        before, without, left = each.folds_before, each.folds_wrinkled, each.folds_contact
        if not without:  # what another mesh passes through
            before, without, left = each.before, each.wrinkled, each.contact
        what, over = f"crossings in a fold that touches, {name}", "those without contact"
        yield Row(f"contact_left_{name}", what, over, left / without, f"{before} -> {without} -> {left}")
        spent = each.seconds - each.seconds_off
        what = f"seconds that contact takes in a fold and its clips, {name}"
        yield Row(f"contact_seconds_{name}", what, "10", spent / 10, f"{spent:.1f} s")
        what = f"morph targets of a fold that touches, {name}"
        yield Row(f"contact_targets_{name}", what, "the 8 that it may have", each.targets / 8, f"{each.targets}")
        lost = 100.0 * each.volume_lost
        what = f"volume that a fold loses, {name}"
        yield Row(f"contact_volume_{name}", what, "1 % of the limb beside it", lost, f"{lost:.2f} %")


# Names of contact_table.py's cases, where those of the rows are others.
_FOLDS = {"elbow": "tube", "knee": "sample_knees"}


SECTIONS = {
    each.__name__: each
    for each in (frames, rates, growth, scaling, density, ways, start, edits, flesh, batches, drawn, blender, contact)
}


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=SECTIONS, help="may be repeated")
    parser.add_argument("--release", help="write a row of this name into results.csv, and README's table")
    parser.add_argument("--readme", action="store_true", help="write README's table from results.csv, and end")
    parser.add_argument("--assets", type=Path, default=ROOT.parent / "shared" / "assets")
    parser.add_argument("--bpy", type=Path, default=ROOT / ".bpy", help="what blender.sh made")
    parser.add_argument("--markdown", action="store_true", help="the table on stdout; its rows meanwhile on stderr")
    parser.add_argument("--tiny", action="store_true", help="run each section once on next to nothing, for its faults")
    options = parser.parse_args()
    if options.readme:
        write_readme(readme_table(recorded()[-1]))
        return 0
    if options.tiny and options.release:
        parser.error("--tiny measures nothing that --release could keep")
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    print(f"load average {load:.2f}, {cores} cores", file=sys.stderr)
    if load > 0.5 * cores:
        print("warning: others are at work on this machine, which disturbs the ratios", file=sys.stderr)
    assets, sizes = (None, TINY) if options.tiny else (options.assets, FULL)
    rows, failed = [], []
    for name in options.only or SECTIONS:
        # In a folder of its own, as all files together take gigabytes.
        with tempfile.TemporaryDirectory() as folder:
            try:
                for row in SECTIONS[name](Places(Path(folder), assets, with_bpy(options.bpy), sizes)):
                    rows.append(row)
                    said = f"ran {name}: {row.what}" if options.tiny else row
                    print(said, file=sys.stderr if options.markdown else sys.stdout, flush=True)
            except Exception:
                # The rows that other sections took an hour for are not lost.
                traceback.print_exc()
                failed.append(name)
    if options.markdown:
        print(markdown(rows))
    if options.release:
        record(options.release, rows)
        write_readme(readme_table(recorded()[-1]))
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
        return 1
    return 0 if options.tiny or all(row.held for row in rows) else 1


def with_bpy(folder: Path) -> str | None:
    """A Python that can import bpy: that of an environment, else this one."""
    own = folder.resolve() / "bin" / "python"
    if own.is_file():
        return str(own)
    return sys.executable if importlib.util.find_spec("bpy") else None


if __name__ == "__main__":
    sys.exit(main())
