"""What baking costs, each as a ratio to something measured in the same run on the same machine.

    python tests/benchmarks/run.py                          all rows, printed as a table
    python tests/benchmarks/run.py --only frames --only help  some
    python tests/benchmarks/run.py --release 0.2.0          also as a row of results.csv
    python tests/benchmarks/run.py --assets DIR             with hand.glb and simple_skin.gltf from there

The rows that Blender is measured in need `bpy` in an environment of its own, which tests/benchmarks/blender.sh makes.
Medians of several runs, alternating with what they are compared with, one thread.

The paper's figures: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on a 1.7 GHz PC.
"""

import argparse
import csv
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_threads] = "1"

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(HERE)]

import numpy as np  # noqa: E402
from assets import finer, longer  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from wrinklecli.config import Length, load_tools  # noqa: E402
from wrinklecli.deform import activities, shapes_of, weights_of  # noqa: E402
from wrinklecli.document import read_document  # noqa: E402
from wrinklecli.plan import Plan, plan_mesh  # noqa: E402
from wrinklecli.pose import Clip, joint_matrices, morph_weights, read_clips  # noqa: E402
from wrinklecli.skin import pose, prepare  # noqa: E402

Floats = NDArray[np.float64]

# Sample, levels, and the paper's frames per second.
WORKLOADS = (("head", 1, 13.0), ("head", 2, 3.6), ("wrist", 0, 188.0), ("wrist", 2, 23.0), ("trousers", 1, 17.0))
CHUNK = 250  # frames
REPEATS = 9
FPS = 30


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: What was measured, without spaces: a column of results.csv.
        text: The same for people, with what it is compared with.
        ratio: Measured over compared.
        reach: The ratio to reach, and
        least: whether it is the least; else the most.
        shown: What was measured, with its unit.
    """

    name: str
    text: str
    ratio: float
    reach: float
    least: bool
    shown: str

    @property
    def held(self) -> bool:
        """Whether the ratio was reached."""
        return self.ratio >= self.reach if self.least else self.ratio <= self.reach


def timed(*jobs: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Median seconds of jobs that take turns."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for _ in range(repeats):
        for job, into in zip(jobs, seconds, strict=True):
            start = time.perf_counter()
            job()
            into.append(time.perf_counter() - start)
    return [statistics.median(each) for each in seconds]


def run(*command: str | Path, code: str = "") -> tuple[float, float]:
    """Seconds, and greatest memory in MB, of a process."""
    arguments = [sys.executable, *(("-c", code) if code else ()), *map(str, command)]
    start = time.perf_counter()
    process = subprocess.Popen(arguments, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = status
    assert status == 0, f"{' '.join(arguments)} failed"
    return time.perf_counter() - start, usage.ru_maxrss / 1024


WRINKLE = "from wrinklecli.cli import main; main()"


def bake(asset: Path, tools: Path, out: Path, *options: str) -> tuple[float, float]:
    """Seconds and MB of a bake, as a process."""
    return run("bake", asset, tools, "-o", out, "-q", *options, code=WRINKLE)


def planned(sample: str, levels: int) -> tuple[Plan, Clip]:
    """A sample's tools, attached and refined, and its first clip."""
    document = read_document(ROOT / "samples" / f"{sample}.glb")
    settings = load_tools(ROOT / "configs" / f"{sample}.yaml")
    settings = replace(settings, refinement=replace(settings.refinement, max_levels=levels))
    node = next(index for index, each in enumerate(document.items("nodes")) if "mesh" in each)
    clips = read_clips(document)
    tools = list(settings.tools)
    return plan_mesh(document, node, tools, settings, clips, Length(1.0, percent=True)), clips[0]


def frames(_: Path, __: Path) -> Iterator[Row]:
    """Posed and wrinkled positions and normals of all members, in process."""
    for workload in WORKLOADS:
        yield from finished(*workload)


def finished(sample: str, levels: int, paper: float) -> Iterator[Row]:
    """The frames of one workload."""
    plan, clip = planned(sample, levels)
    rig, fine = plan.rig, plan.fine
    patches = [each.patch for each in plan.carriers]
    members = np.unique(np.concatenate([each.vertices for each in plan.carriers]))
    weights, positions = fine.dense_weights(members, len(rig.joints)), fine.positions[members]
    every = [shape for each in plan.carriers for shape in shapes_of(each, fine, with_normals=True)]
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
        seen = activities(patches, rig, plan.rest, clip, times)
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
    label = f"finished frames, {sample}, {levels} levels, {len(members)} members"
    rate = CHUNK / whole
    yield Row(
        f"frames_{sample}_{levels}", f"{label}: over the paper's {paper:g}", rate / paper, 100, True, f"{rate:,.0f}/s"
    )
    each = f"{1e9 * finishing / CHUNK / len(members):.0f} ns per vertex"
    text = f"{label}: time over skinning positions alone"
    yield Row(f"floor_{sample}_{levels}", text, finishing / least, 3, False, each)


def spread(vertices: NDArray[np.intp], values: Floats, members: NDArray[np.intp]) -> Floats:
    """(members, 3) of values of some vertices, 0 elsewhere."""
    dense = np.zeros((int(max(members.max(), vertices.max(initial=0))) + 1, 3))
    dense[vertices] = values
    return dense[members]


def rates(folder: Path, _: Path) -> Iterator[Row]:
    """What a longer clip costs more."""
    for sample, levels, paper in WORKLOADS:
        rate = 20_000 / longer_costs(folder, sample, levels)
        text = f"frames of a longer clip that a bake takes, {sample}, {levels} levels: over the paper's {paper:g}"
        yield Row(f"bake_{sample}_{levels}", text, rate / paper, 500, True, f"{rate:,.0f} frames/s")


def longer_costs(folder: Path, sample: str, levels: int) -> float:
    """Seconds that 20,000 frames more take."""
    asset, tools = ROOT / "samples" / f"{sample}.glb", ROOT / "configs" / f"{sample}.yaml"
    short = longer(asset, folder / f"{sample}_short.glb", 100 / FPS)
    long = longer(asset, folder / f"{sample}_long.glb", 20_100 / FPS)

    def job(clip: Path) -> None:
        bake(clip, tools, folder / "out.glb", "--max-levels", str(levels))

    brief, extended = timed(lambda: job(short), lambda: job(long), repeats=5)
    return extended - brief


def growth(folder: Path, _: Path) -> Iterator[Row]:
    """Bytes, memory and time of long clips."""
    tools, asset = ROOT / "configs" / "trousers.yaml", ROOT / "samples" / "trousers.glb"
    clips = {count: longer(asset, folder / f"trousers_{count}.glb", count / FPS) for count in (100, 1000, 10_000)}
    for mode, reach in (("morph", 1.5), ("frames", 2.5)):
        peaks, seconds = {}, {}
        for count in (100, 10_000):
            runs = [bake(clips[count], tools, folder / f"{mode}_{count}.glb", "--mode", mode) for _ in range(3)]
            peaks[count] = statistics.median(peak for _, peak in runs)
            seconds[count] = statistics.median(each for each, _ in runs)
        text = f"peak memory, trousers, --mode {mode}: 10,000 frames over 100"
        yield Row(f"memory_{mode}", text, peaks[10_000] / peaks[100], reach, False, f"{peaks[10_000]:.0f} MB")
        per_frame = seconds[10_000] / 10_000 / (seconds[100] / 100)
        text = f"time per frame, trousers, --mode {mode}: 10,000 frames over 100"
        yield Row(f"pace_{mode}", text, per_frame, 1.0, False, f"{1e3 * seconds[10_000] / 10_000:.2f} ms")
    grown, tracks = [], []
    for count in (1000, 10_000):
        out = folder / f"growth_{count}.glb"
        bake(clips[count], tools, out)
        grown.append(out.stat().st_size - clips[count].stat().st_size)
        tracks.append(track_bytes(out))
    text = "bytes that ten times the frames add, trousers: over those of the weight tracks"
    ratio = (grown[1] - grown[0]) / (tracks[1] - tracks[0])
    yield Row("bytes", text, ratio, 1.001, False, f"{(grown[1] - grown[0]) / 1e3:,.0f} kB")


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


def density(folder: Path, assets: Path) -> Iterator[Row]:
    """A bake of a mesh that is sixteen times as fine outside the patch."""
    asset = assets / "hand.glb"
    if not asset.is_file():
        print(f"no {asset.name} in --assets: its rows are left out", file=sys.stderr)
        return
    centre = np.array([-0.473, 0.2465, 0.1938])
    dense = finer(asset, folder / "dense.glb", keep=(centre, 0.06), rounds=2)
    tools = folder / "hand.yaml"
    tools.write_text(
        "version: 1\ntools:\n  - {name: wrist, origin: [-0.4622, 0.2576, 0.1750], target: [-0.4838, 0.2355, 0.2126],"
        " width: 0.05, bumps: 4}\n"
    )
    copy = (
        "import sys; from wrinklecli.document import read_document; from wrinklecli.draft import Draft\n"
        "Draft(read_document(sys.argv[1])).write(sys.argv[2])"
    )
    fine, copied = timed(
        lambda: bake(dense, tools, folder / "out.glb"), lambda: run(dense, folder / "copy.glb", code=copy), repeats=7
    )
    text = "baking hand.glb with 16 times the triangles outside the patch: over reading and writing it"
    yield Row("density", text, fine / copied, 1.5, False, f"{fine:.2f} s")


def start(folder: Path, assets: Path) -> Iterator[Row]:
    """Short commands, over a Python that imports numpy."""
    help_time, importing = timed(lambda: run("--help", code=WRINKLE), lambda: run(code="import numpy"), repeats=11)
    yield Row(
        "help", "wrinkle --help: over python importing numpy", help_time / importing, 1.0, False, f"{help_time:.2f} s"
    )
    asset = assets / "simple_skin.gltf"
    if not asset.is_file():
        print(f"no {asset.name} in --assets: its row is left out", file=sys.stderr)
        return
    tools = folder / "bend.yaml"
    tools.write_text(
        "version: 1\ntools:\n  - {name: bend, origin: [-0.4, 0.6, 0.0], target: [-0.4, 1.4, 0.0], width: 0.8,"
        " bumps: 2}\n"
    )
    baking, importing = timed(
        lambda: bake(asset, tools, folder / "out.glb"), lambda: run(code="import numpy"), repeats=11
    )
    yield Row(
        "simple_skin",
        "baking simple_skin.gltf: over python importing numpy",
        baking / importing,
        4.0,
        False,
        f"{baking:.2f} s",
    )


SECTIONS = {each.__name__: each for each in (frames, rates, growth, density, start)}


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=SECTIONS, help="may be repeated")
    parser.add_argument("--release", help="append a row of this name to results.csv")
    parser.add_argument("--assets", type=Path, default=ROOT.parent / "shared" / "assets")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.only or SECTIONS:
            for row in SECTIONS[name](Path(folder), options.assets):
                rows.append(row)
                sign = "≥" if row.least else "≤"
                print(
                    f"{'ok ' if row.held else 'NOT'} {row.text}: {row.ratio:.3g} ({sign} {row.reach:g}), {row.shown}",
                    flush=True,
                )
    if options.release:
        record(options.release, rows)
    return 0 if all(row.held for row in rows) else 1


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
