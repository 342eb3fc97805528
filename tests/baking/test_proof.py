"""The proof of the bake: wrong files are refused, and the residuals are the true ones."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.bakes import bake_once, folding_limb
from kit.limb import tool, write_tools
from kit.player import Floats, Gltf, Json
from kit.samples import BROW, PALM, edited, sample, sharp_keys
from wrinklecli.baking import morphs as encode
from wrinklecli.baking import pipeline
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.baking.proof import Residual, prove
from wrinklecli.character import weight_track
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.drive import play
from wrinklecli.effects import plan as plan_module
from wrinklecli.effects.effect import Effect, MeshPlan, SamplingOptions, Target
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.effects.wrinkle.carry import displacements
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.errors import RefusedError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.numeric.guard import log_progress
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import Length


def planned(asset: Path, tools: Path, **options: Any) -> MeshPlan:
    """The plan of a bake of one mesh."""
    document, settings = read_document(asset), load_tools(tools)
    return plan_mesh(
        document,
        0,
        list(settings.tools),
        settings,
        read_clips(document),
        options.get("max_error", Length(1.0, percent=True)),
    )


def method(plan: MeshPlan, asset: Path, clip: str, times: Floats) -> Floats:
    """(times, glTF vertices, 3) what the method itself makes of a clip: no pruning, no targets, no tracks."""
    rig, fine = plan.rig, plan.fine
    (found,) = (each for each in read_clips(read_document(asset)) if each.name == clip)
    bind = fine.positions + np.tensordot(morph_weights(rig, found, times), fine.morph_deltas, axes=1)
    for carried in carried_patches_of(plan):
        lengths = carried.patch.segment.lengths(rig, found, times)
        # By the curve itself, not by its table.
        amplitudes, _ = carried.patch.curve.follow(lengths.distances, lengths.rest_lengths)
        bind[:, carried.vertices] += displacements(carried, fine, rig, found, times, amplitudes)
    weights = fine.dense_weights(np.arange(len(fine.positions)), len(rig.joints))
    moved = transform(blend(weights, joint_matrices(rig, found, times)), bind)
    starts, old = fine.surface.vertex_starts, len(fine.surface.weld)
    order: list[int] = []
    for primitive in range(len(starts) - 1):
        order += range(starts[primitive], starts[primitive + 1])
        order += (old + np.flatnonzero(fine.primitives == primitive)).tolist()
    return moved[:, fine.weld[order]]


def refused(tmp_path: Path, asset: Path, tool: Json, **options: Any) -> str:
    """Bake what must be refused; nothing is written, and an old OUT stays."""
    tools, out = write_tools(tmp_path / "tools.yaml", tool), tmp_path / "out.glb"
    out.write_bytes(b"old")
    with pytest.raises(RefusedError) as caught:
        wrinklecli.bake(asset, tools, out, **options)
    assert caught.value.exit_code == 3
    assert out.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.glb", "tools.yaml"]
    return str(caught.value)


def bend_shape(target: Target) -> Target:
    """One vertex in the middle is off by 3 % of the tallest."""
    shape = target.shape
    deltas = shape.deltas.copy()
    place = int(np.argmax(np.abs(deltas).max(axis=1)))
    deltas[place] *= 1.03
    return dataclasses.replace(target, shape=dataclasses.replace(shape, deltas=deltas))


def stray_vertex(target: Target) -> Target:
    """A vertex that no tool touches moves too."""
    shape = target.shape
    stray = next(vertex for vertex in range(10_000) if vertex not in set(shape.vertices.tolist()))
    order = np.argsort([*shape.vertices, stray])
    moved = np.concatenate([shape.deltas, np.abs(shape.deltas).max() * np.ones((1, 3))])
    changed = dataclasses.replace(shape, vertices=np.append(shape.vertices, stray)[order], deltas=moved[order])
    return dataclasses.replace(target, shape=changed)


@pytest.mark.quick(1)
@pytest.mark.parametrize("damage", [bend_shape, stray_vertex])
def test_a_wrong_shape_is_refused(
    damage: Callable[[Target], Target], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode_mesh = encode.encode_mesh

    def wrong(edited: Any, rig: Any, fine: Any, targets: Any, **options: Any) -> None:
        encode_mesh(edited, rig, fine, [damage(target) for target in targets], **options)

    monkeypatch.setattr(encode, "encode_mesh", wrong)
    message = refused(tmp_path, sample("wrist"), PALM)
    assert "flex" in message
    assert "--max-error" in message


def late(times: Floats, weights: Floats) -> tuple[Floats, Floats]:
    return times, np.vstack([weights[:1], weights[:-1]])


def swollen(times: Floats, weights: Floats) -> tuple[Floats, Floats]:
    return times, weights * 1.02


def thinned(times: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Right at its keys, wrong between them."""
    kept = np.append(np.arange(0, len(times) - 1, 3), len(times) - 1)
    return times[kept], weights[kept]


@pytest.mark.quick(1)
@pytest.mark.parametrize("damage", [late, swollen, thinned])
def test_wrong_weights_are_refused(damage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    widen = weight_track.widen

    def wrong(channel: Any, rig: Any, clip: Any, times: Floats, weights: Floats) -> Any:
        return widen(channel, rig, clip, *damage(times, weights))

    monkeypatch.setattr(encode, "widen", wrong)
    refused(tmp_path, sample("wrist"), PALM)


def test_wrong_old_morph_weights_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    widen = weight_track.widen

    def wrong(*arguments: Any) -> Any:
        track = widen(*arguments)
        values = track.values.copy()
        values[..., 0] *= 0.99
        return dataclasses.replace(track, values=values)

    monkeypatch.setattr(encode, "widen", wrong)
    refused(tmp_path, sample("head"), BROW)


@pytest.mark.quick(1)
@pytest.mark.parametrize("clip", ["flex", "extend"])  # in extend no wrinkle rises
def test_wrong_skin_weights_of_new_vertices_are_refused(
    clip: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refine = plan_module.refine

    def wrong(*arguments: Any, **options: Any) -> Any:
        fine = refine(*arguments, **options)
        weights = fine.weights_pruned.copy()
        mixed = np.flatnonzero((weights[:, 0] < 0.8) & (weights[:, 1] > 0.05))[0]
        weights[mixed, :2] += [0.04, -0.04]
        return dataclasses.replace(fine, weights_pruned=weights)

    monkeypatch.setattr(plan_module, "refine", wrong)
    assert clip in refused(tmp_path, sample("wrist"), PALM, clips=[clip])


@pytest.mark.quick(1)
@pytest.mark.parametrize("path", ["rotation", "weights"])
def test_a_clip_without_wrinkles_that_plays_otherwise_is_refused(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A joint of the written file turns otherwise, or its weights raise wrinkles that the method lacks."""
    encode_morphs = encode.encode_morphs

    def wrong(edited: EditedDocument, *arguments: Any, **options: Any) -> Any:
        names = encode_morphs(edited, *arguments, **options)
        (clip,) = (each for each in edited.gltf["animations"] if each["name"] == "extend")
        (number, *_) = (each["sampler"] for each in clip["channels"] if each["target"]["path"] == path)
        sampler = clip["samplers"][number]
        values = edited.document().accessor(sampler["output"]).astype(np.float32)
        if path == "rotation":
            half = np.radians(1.0) / 2.0  # about the joint's own axis z
            x, y, z, w = values.T
            turned = [x * np.cos(half) + y * np.sin(half), y * np.cos(half) - x * np.sin(half)]
            values = np.stack(
                [*turned, z * np.cos(half) + w * np.sin(half), w * np.cos(half) - z * np.sin(half)], axis=1
            )
        else:
            values[len(values) // 2] += 0.1
        sampler["output"] = edited.add(values.astype(np.float32), replaces=sampler["output"])
        return names

    monkeypatch.setattr(pipeline, "encode_morphs", wrong)
    assert "extend" in refused(tmp_path, sample("wrist"), PALM, clips=["extend"])


def test_a_wrong_place_of_a_new_vertex_is_refused_in_a_clip_without_wrinkles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode_mesh = encode.encode_mesh

    def wrong(edited: Any, rig: Any, fine: Any, targets: Any, **options: Any) -> None:
        positions = fine.positions.copy()
        positions[-1] += 1e-4
        encode_mesh(edited, rig, dataclasses.replace(fine, positions=positions), targets, **options)

    monkeypatch.setattr(encode, "encode_mesh", wrong)
    assert "extend" in refused(tmp_path, sample("wrist"), PALM, clips=["extend"])


def test_a_bound_below_what_the_file_can_hold_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound stands as it was asked for; only float32's own error is not held against the file."""
    monkeypatch.setattr(play, "KEY_GAP", 1.0)
    refused(tmp_path, sample("wrist"), PALM, max_error=Length(0.01, percent=True))


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize(
    ("asset", "tool", "clip", "percent"),
    [
        ("wrist", PALM, "flex", 1.0),
        ("wrist", {**PALM, "strategy": "origin", "bumps": 5, "max_height": "4%"}, "flex", 0.2),
        ("wrist", {**PALM, "profile": "polyline", "details": [0.2]}, "flex", 0.2),
        ("wrist", {**PALM, "attachment": "patch", "bumps": 2}, "flex", 0.5),
        ("head", {**BROW, "strategy": "both_ends"}, "raise_brows", 0.2),
    ],
)
def test_residuals_are_those_of_an_independent_comparison(
    asset: str, tool: Json, clip: str, percent: float, tmp_path: Path
) -> None:
    tools, out, bound = write_tools(tmp_path / "tools.yaml", tool), tmp_path / "out.glb", Length(percent, percent=True)
    report = wrinklecli.bake(sample(asset), tools, out, max_error=bound, clips=[clip], details=True)
    made = planned(sample(asset), tools, max_error=bound)
    (mesh,) = report.data["meshes"]
    assert mesh["max_error"] == made.max_error == pytest.approx(percent / 100 * made.tallest)
    residual = next(each["residual"] for each in report.data["clips"] if each["name"] == clip)
    file = Gltf(out)
    keys = file.keys(clip, asset)[0]
    spans = np.diff(keys)[:, None]
    # What is between two keys that are a millisecond or two apart is not compared.
    between = (keys[:-1, None] + [0.25, 0.5] * spans)[spans[:, 0] >= 0.002].reshape(-1)
    every = np.union1d(keys, between)
    # Where a wrinkle starts its height is steep: the time itself, not its rounded digits.
    worst = every[np.argmin(np.abs(every - residual["time"]))]
    assert abs(worst - residual["time"]) < 1e-6
    times = np.union1d(every[:: 1 + len(every) // 60], worst)
    gaps = np.linalg.norm(file.pose(asset, clip, times) - method(made, sample(asset), clip, times), axis=2).max(axis=1)
    at = int(np.searchsorted(times, worst))
    # A bound, which adds up what shapes, skin and weights are off: written with four digits.
    assert gaps[at] <= residual["position"] * (1.0 + 1e-3) <= 1.25 * gaps[at] + 1e-7
    assert gaps.max() <= made.max_error
    assert 0 < residual["position"] <= made.max_error
    assert residual["weights"] <= made.max_error
    assert residual["normal_degrees_99"] > 0


@pytest.mark.slow
def test_jumps_are_proven_too(tmp_path: Path) -> None:
    asset = edited("head", sharp_keys)
    tools, out = write_tools(tmp_path / "tools.yaml", BROW), tmp_path / "out.glb"
    wrinklecli.bake(asset, tools, out)
    jumps = np.float32([0.5, 1.25, 2.0])
    # Up to a millisecond before a jump, in which weights cross over.
    times = np.concatenate([jumps, jumps - np.float32(0.00101), jumps - np.float32(0.01)]).astype(np.float64)
    made = planned(asset, tools)
    gaps = np.abs(Gltf(out).pose("head", "raise_brows", times) - method(made, asset, "raise_brows", times))
    assert gaps.max() < made.max_error


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("asset", "tool", "clip", "rate"), [("wrist", PALM, "flex", 24), ("head", BROW, "raise_brows", 60)]
)
def test_whole_frames_of_a_player_are_right(asset: str, tool: Json, clip: str, rate: int, tmp_path: Path) -> None:
    """Between two keys a millisecond apart nothing is compared: that no frame falls there is what makes it right."""
    tools = write_tools(tmp_path / "tools.yaml", tool)
    made, file = planned(sample(asset), tools), bake_once(asset, tool)
    times = (np.arange(2 * rate + 1) / rate).astype(np.float32).astype(np.float64)
    gaps = np.linalg.norm(file.pose(asset, clip, times) - method(made, sample(asset), clip, times), axis=2)
    assert gaps.max() <= made.max_error


def test_the_tallest_wrinkle_bounds_what_is_displaced(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", {**PALM, "max_height": "6%"})
    report = wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb")
    tallest = report.data["tallest_wrinkle"]
    segment = np.linalg.norm(np.subtract(PALM["target"], PALM["origin"]))
    assert tallest == pytest.approx(0.06 * segment, rel=0.01)
    file = Gltf(tmp_path / "out.glb")
    deltas = np.linalg.norm(file.deltas("wrist"), axis=2)
    assert 0.9 * tallest < deltas.max() < 1.001 * tallest


@pytest.mark.slow
@pytest.mark.long
def test_targets_of_contact_are_proven_as_those_of_tools(tmp_path: Path) -> None:
    """One fold, solved once and written four times: rightly, with wrong shapes, and with wrong weights."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    crease = tool(bumps=3, max_height="10%", contact="resolve")
    job = read_job(folding_limb(), write_tools(tmp_path / "tools.yaml", crease), BakeOptions(max_levels=1))
    (plan,) = plan_meshes(job, influences=None)
    effects, motions = sample_effects(
        plan, job.clips, SamplingOptions(30.0, "morph", job.document.memory, log_progress)
    )
    (motion,), (_, fold) = motions, effects

    def residual(
        written: Sequence[Effect] = effects, change: Callable[[Floats], Floats] = lambda each: each
    ) -> Residual:
        edited = EditedDocument(job.document)
        changed = dataclasses.replace(motion, weights=(*motion.weights[:-1], change(motion.weights[-1])))
        encode.encode_morphs(edited, plan, written, [changed])
        return prove(edited, plan, effects, motions, details=True, progress=log_progress)[motion.clip.name]

    found = residual()
    assert 0.0 < found.weights < plan.max_error / 2
    assert found.position < plan.max_error
    damaged = [stray_vertex(each) for each in fold.targets]
    with pytest.raises(RefusedError):
        residual([*effects[:-1], dataclasses.replace(fold, targets=tuple(damaged))])
    with pytest.raises(RefusedError):
        residual(change=lambda each: 1.1 * each)
    # A track that is late is wrong between the frames at which whole shapes are compared, too.
    with pytest.raises(RefusedError):
        residual(change=lambda each: np.vstack([each[:1], each[:-1]]))
