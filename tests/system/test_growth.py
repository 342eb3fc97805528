"""What a bake costs as clips get longer and meshes larger, counted in work and bytes instead of seconds."""

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Asset
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.player import Gltf
from wrinklecli import bake
from wrinklecli.baking import plan, proof
from wrinklecli.baking.apart import Pair
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.character import pose
from wrinklecli.effects import sampling
from wrinklecli.effects.effect import MeshPlan, Motion, SamplingOptions
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.effects.wrinkle import projected
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.gltf import new_data
from wrinklecli.numeric import piecewise as tracks
from wrinklecli.numeric import red_green
from wrinklecli.numeric.guard import log_progress
from wrinklecli.numeric.memory import Memory

# Frames per second, and seconds in which the limb folds and unfolds.
FPS, PERIOD = 30, 2.0


def folding(periods: int, *, joints: int = 2, sheet: int = 0) -> Asset:
    """A limb that folds again and again.

    Args:
        periods: How often.
        joints: Of the limb.
        sheet: Cells along a square sheet beside it that follows the first joint: so fine, and always as large.
    """
    asset = limb_asset(joints=joints, clip=None)
    if sheet:
        x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-1.0, 1.0, sheet + 1)] * 2, indexing="ij"))
        zeros, ones = np.zeros(len(x)), np.ones(len(x))
        a = np.arange(len(x)).reshape(sheet + 1, sheet + 1)
        cells = [each.ravel() for each in (a[:-1, :-1], a[1:, :-1], a[:-1, 1:], a[1:, 1:])]
        faces = np.stack([cells[0], cells[1], cells[2], cells[1], cells[3], cells[2]], axis=1)
        values: dict[str, tuple[Any, str]] = {
            "POSITION": (np.stack([x, y, zeros - 1.5], axis=1), "f4"),
            "NORMAL": (np.stack([zeros, zeros, ones], axis=1), "f4"),
            "TEXCOORD_0": (np.stack([x, y], axis=1), "f4"),
            "JOINTS_0": (np.zeros((len(x), 4)), "u1"),
            "WEIGHTS_0": (np.stack([ones, zeros, zeros, zeros], axis=1), "f4"),
        }
        attributes = {
            name: asset.accessor(each, dtype, bounds=name == "POSITION", target=ARRAY_BUFFER)
            for name, (each, dtype) in values.items()
        }
        indices = asset.accessor(faces.ravel(), "u2", target=ELEMENT_ARRAY_BUFFER)
        asset.gltf["meshes"][0]["primitives"].append({"attributes": attributes, "indices": indices})
    animation: dict[str, Any] = {"name": "fold"}
    half = np.radians(100.0 / (joints - 1)) / 2.0 * (np.arange(2 * periods + 1) % 2)
    turns = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    for joint in range(1, joints):
        asset.channel(animation, 1 + joint, "rotation", np.arange(len(half)) * PERIOD / 2, turns)
    asset.append("animations", animation)
    return asset


class Baker:
    """Bakes assets in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        # On the near half: the joints behind the middle move nothing of it.
        near = tool(origin=[-0.9, RADIUS, 0.0], target=[-0.1, RADIUS, 0.0], bumps=8)
        self.tools = write_tools(folder / "tools.yaml", near, sampling={"fps": FPS}, refinement={})

    def written(self, asset: Asset) -> Path:
        return asset.write(self.folder / "asset.glb")

    def sample(self, asset: Asset) -> tuple[MeshPlan, Motion]:
        """The asset's mesh with its tool, and its clip, sampled."""
        job = read_job(self.written(asset), self.tools, BakeOptions())
        (planned,) = plan.plan_meshes(job)
        _, (motion,) = sample_effects(planned, job.clips, SamplingOptions(FPS, "morph", Memory(), log_progress))
        return planned, motion

    def bake(self, asset: Asset, **options: Any) -> tuple[Gltf, int]:
        """The output, and how many bytes it has more than the asset."""
        source, out = self.written(asset), self.folder / "out.glb"
        report = bake(source, self.tools, out, **options)
        assert report.bytes_written == out.stat().st_size
        return Gltf(out), report.bytes_written - source.stat().st_size

    def peak(self, asset: Asset, **options: Any) -> int:
        """The most bytes that Python and numpy held during a bake."""
        source = self.written(asset)
        tracemalloc.start()
        try:
            bake(source, self.tools, self.folder / "out.glb", **options)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()


@pytest.fixture
def baker(tmp_path: Path) -> Baker:
    return Baker(tmp_path)


@pytest.fixture
def small_spool(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets a file on disk take over from memory earlier, to see it with small assets."""
    monkeypatch.setattr(new_data, "_SPOOL_BYTES", 2**20)


def counting(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, count: Callable[..., Any]) -> list[Any]:
    """Have a function note what `count` makes of its arguments."""
    counted: list[Any] = []
    original = getattr(module, name)

    def noted(*arguments: Any, **options: Any) -> Any:
        counted.append(count(*arguments, **options))
        return original(*arguments, **options)

    monkeypatch.setattr(module, name, noted)
    return counted


def frames_of(periods: int) -> int:
    return round(periods * PERIOD * FPS)


def track_bytes(file: Gltf) -> int:
    """Bytes of the weight tracks, times and values."""
    total = 0
    for animation in file.json["animations"]:
        for channel in animation["channels"]:
            if channel["target"]["path"] == "weights":
                sampler = animation["samplers"][channel["sampler"]]
                total += sum(file.stored(sampler[key]).nbytes for key in ("input", "output"))
    return total


# Work by frame


def test_only_joints_that_move_anchors_are_evaluated(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    evaluated = counting(monkeypatch, pose, "_local_rows", lambda _rig, _clip, times, nodes: (nodes, len(times)))
    planned, _ = baker.sample(folding(3, joints=6))
    rig = planned.rig
    points = [point for each in carried_patches_of(planned) for point in each.patch.segment.points]
    anchored = {node for each in points for node in each.nodes.tolist()}
    # The clip turns the second joint, so that the root stays as it is stored.
    wanted = {node for each in anchored for node in rig.upwards(each)} - {int(rig.joints[0])}
    assert wanted < set(rig.joints[1:].tolist())
    assert {node for nodes, count in evaluated if count > 1 for node in nodes} == wanted


@pytest.mark.slow
def test_a_longer_clip_takes_as_many_evaluations_for_each_frame(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    evaluated = counting(monkeypatch, pose, "_local_rows", lambda _rig, _clip, times, nodes: (nodes, len(times)))
    found = []
    for periods in (10, 100):
        evaluated.clear()
        _, motion = baker.sample(folding(periods))
        every = {node for nodes, _ in evaluated for node in nodes}
        found.append(
            [
                sum(count * len(nodes) for nodes, count in evaluated) / len(every) / frames_of(periods),
                len(motion.times) / frames_of(periods),
                len(motion.keys) / periods,
            ]
        )
    (evaluations, times, keys), longer = found
    # Each frame and three points between two, halved where heights start, and once more each time that this leaves.
    assert evaluations < 8
    assert times < 2
    assert keys < frames_of(1)
    assert longer == pytest.approx(found[0], rel=0.1)


@pytest.mark.slow
def test_a_long_clip_is_sampled_in_stretches(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = counting(monkeypatch, tracks, "_bisected", lambda grid, *_: grid)
    baker.sample(folding(400))
    # Rows of tables go from 0 to 1.
    parts = [len(grid) for grid in counted if grid[-1] > 1.0]
    assert max(parts) < frames_of(400) / 2
    # Each ends where the next one starts.
    assert sum(parts) == frames_of(400) + len(parts)


def test_sampling_moves_no_vertex(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    moved = counting(monkeypatch, projected, "displacements", lambda *_: None)
    baker.sample(folding(3))
    assert moved == []


@pytest.mark.slow
def test_the_proof_poses_as_much_of_any_clip_and_of_any_mesh(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    posed = counting(
        monkeypatch,
        Pair,
        "bounds",
        lambda bodies, method, *_: (len(method.matrices), len(bodies.first)),
    )
    found = []
    for periods, sheet in ((10, 0), (100, 0), (10, 64)):
        posed.clear()
        file, _ = baker.bake(folding(periods, sheet=sheet))
        # The vertices are compared block after block, each in all frames.
        found.append((*{frames for frames, _ in posed}, sum(vertices for _, vertices in posed)))
    ((frames, vertices), *others) = found
    # Even ones, and those where the tool is tallest and weights are off most.
    assert frames <= proof._FRAMES + proof._WORST + 2
    assert vertices < len(file.attribute("limb", "POSITION"))
    for other in others:
        assert other == (pytest.approx(frames, abs=6), vertices)


def test_a_take_of_several_names_is_looked_into_once(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    sampled = counting(monkeypatch, sampling, "_times", lambda _plan, _effects, clip, *_: clip.name)
    proven = counting(monkeypatch, proof, "measure_residual", lambda *arguments, **_: arguments[4].name)
    asset = folding(3)
    (fold,) = asset.gltf["animations"]
    asset.gltf["animations"] += [{**fold, "name": "Armature|fold"}, {**fold, "name": "weak"}]
    tools = json.loads(baker.tools.read_text())
    tools["tools"][0]["clips"] = {"weak": 0.5}
    baker.tools.write_text(json.dumps(tools))
    file, _ = baker.bake(asset)
    assert sampled == proven == ["fold", "weak"]
    times = np.linspace(0, 3 * PERIOD, 100)
    full, same, weak = (file.weights("limb", name, times) for name in ("fold", "Armature|fold", "weak"))
    assert np.array_equal(full, same)
    assert full.max() > 0.5
    assert np.abs(weak - full / 2).max() < 0.006


@pytest.mark.slow
def test_all_levels_hold_the_patch_alone(baker: Baker, monkeypatch: pytest.MonkeyPatch) -> None:
    built = counting(monkeypatch, red_green, "_level", lambda number, *rest: (number, len(rest[2])))
    found = []
    for sheet in (0, 16, 64):
        built.clear()
        baker.bake(folding(1, sheet=sheet))
        found.append(list(built))
    (coarse,) = (count for number, count in found[0] if not number)
    assert coarse < 736 / 2
    assert len(found[0]) > 2
    assert found[1:] == found[:1] * 2


@pytest.mark.slow
def test_progress_moves_within_a_long_clip(baker: Baker) -> None:
    shown: list[tuple[int, int]] = []

    def note(stage: str, done: int, total: int) -> None:
        if stage == "sampling":
            shown.append((done, total))

    baker.bake(folding(400), progress=note)
    done, totals = zip(*shown, strict=True)
    assert set(totals) == {frames_of(400) + 1}
    assert list(done) == sorted(done)
    assert done[-1] == totals[-1]
    assert max(np.diff(done)) < totals[-1] / 2


# Bytes

# Numbers of more digits in the JSON, all together.
DIGITS = 64


@pytest.mark.slow
def test_a_longer_clip_adds_the_bytes_of_its_weight_tracks(baker: Baker) -> None:
    (short, added), (long, added_longer) = (baker.bake(folding(periods)) for periods in (10, 100))
    assert abs((added_longer - added) - (track_bytes(long) - track_bytes(short))) <= DIGITS
    assert track_bytes(long) == pytest.approx(10 * track_bytes(short), rel=0.05)


@pytest.mark.slow
def test_a_finer_mesh_elsewhere_adds_no_byte(baker: Baker) -> None:
    found = [baker.bake(folding(1, sheet=sheet)) for sheet in (16, 64, 128)]
    first = found[0][1]
    for file, added in found:
        assert abs(added - first) <= DIGITS
        targets = [target for primitive in file.mesh("limb")["primitives"] for target in primitive["targets"]]
        accessors = [file.json["accessors"][index] for target in targets for index in target.values()]
        assert any("sparse" in each for each in accessors)
        assert not [each for each in accessors if "bufferView" in each]


# Memory


@pytest.mark.slow
@pytest.mark.long
def test_memory_hardly_grows_with_the_clip(baker: Baker) -> None:
    # Both longer than what is sampled or proven at once.
    short, long = (baker.peak(folding(periods)) for periods in (300, 900))
    # A hundred numbers for each frame, where all that is looked at between two frames would take thousands.
    assert long - short < 800 * frames_of(600)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("small_spool")
@pytest.mark.parametrize("sheet", [0, 32])
def test_memory_of_posed_frames_does_not_hold_them(baker: Baker, sheet: int) -> None:
    found = []
    for periods in (2, 12):
        peak = baker.peak(folding(periods, sheet=sheet), mode="frames")
        found.append((peak, (baker.folder / "out.glb").stat().st_size))
    (short, less), (long, more) = found
    # The JSON of a frame's node, mesh and accessors, whatever its size.
    assert long - short < min(8000 * frames_of(10), (more - less) / 4)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("small_spool")
@pytest.mark.parametrize(("mode", "each"), [("morph", 3000), ("frames", 6000)])
def test_memory_grows_evenly_with_a_mesh_elsewhere(baker: Baker, mode: str, each: int) -> None:
    # Bytes for a vertex with its two triangles; in mode frames, posed at some times too.
    coarse, fine = (baker.peak(folding(1, sheet=sheet), mode=mode) for sheet in (64, 128))
    assert fine - coarse < each * (129**2 - 65**2)
