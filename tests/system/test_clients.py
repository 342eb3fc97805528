"""The clients themselves, on a file small enough to pose by hand."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit import clients
from kit.clients import assert_valid, compare_with_three, pose, pose_with_normals, validate

# A strip of two triangles, twice as tall as wide. Joint 0 stands at the foot, joint 1 half-way up.
STRIP = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (1, 2, 0)], np.float32)


def tiny_glb(path: Path, *, offsets: tuple[float, ...] = (0.0,), top_joint: int = 1) -> Path:
    """Write the strip, skinned and morphed: in `wave` (1 s) joint 1 turns by 90° about z and corner 3 rises.

    Args:
        path: Where to.
        offsets: A primitive for each, moved along z by that much.
        top_joint: Joint of the upper two vertices; only 0 and 1 exist.
    """
    blob = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def view(values: np.ndarray) -> int:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": values.nbytes})
        blob.extend(values.tobytes() + bytes(-values.nbytes % 4))
        return len(views) - 1

    def accessor(values: np.ndarray, kind: str, component: int, **more: Any) -> int:
        accessors.append(
            {
                "bufferView": view(values),
                "componentType": component,
                "count": len(values),
                "type": kind,
                **more,
            }
        )
        return len(accessors) - 1

    primitives = []
    for offset in offsets:
        positions = STRIP + np.float32([0, 0, offset])
        joints = np.zeros((4, 4), np.uint8)
        joints[2:, 0] = top_joint
        weights = np.tile(np.float32([1, 0, 0, 0]), (4, 1))
        attributes = {
            "POSITION": accessor(positions, "VEC3", 5126, min=positions.min(0).tolist(), max=positions.max(0).tolist()),
            "NORMAL": accessor(np.tile(np.float32([0, 0, 1]), (4, 1)), "VEC3", 5126),
            "JOINTS_0": accessor(joints, "VEC4", 5121),
            "WEIGHTS_0": accessor(weights, "VEC4", 5126),
        }
        morph_target = {}
        for name, delta in {"POSITION": (0, 0, 0.5), "NORMAL": (0, 1, 0)}.items():
            accessors.append(
                {
                    "componentType": 5126,
                    "count": 4,
                    "type": "VEC3",
                    "min": np.minimum(delta, 0).tolist(),
                    "max": np.maximum(delta, 0).tolist(),
                    "sparse": {
                        "count": 1,
                        "indices": {"bufferView": view(np.uint16([3])), "componentType": 5123},
                        "values": {"bufferView": view(np.float32([delta]))},
                    },
                }
            )
            morph_target[name] = len(accessors) - 1
        indices = accessor(np.uint16([0, 1, 2, 2, 1, 3]), "SCALAR", 5123)
        primitives.append({"attributes": attributes, "indices": indices, "targets": [morph_target]})

    inverse_binds = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse_binds[1, 3, 1] = -1  # by columns: one unit down
    inverse_bind_matrices = accessor(inverse_binds.reshape(2, 16), "MAT4", 5126)
    times = accessor(np.float32([0, 1]), "SCALAR", 5126, min=[0], max=[1])
    turns = accessor(np.float32([(0, 0, 0, 1), (0, 0, 0.5**0.5, 0.5**0.5)]), "VEC4", 5126)
    rises = accessor(np.float32([0, 1]), "SCALAR", 5126)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "foot", "children": [1]},
            {"name": "middle", "translation": [0, 1, 0]},
            {"name": "strip", "mesh": 0, "skin": 0},
        ],
        "meshes": [{"primitives": primitives, "weights": [0]}],
        "skins": [{"joints": [0, 1], "inverseBindMatrices": inverse_bind_matrices}],
        "animations": [
            {
                "name": "wave",
                "samplers": [{"input": times, "output": turns}, {"input": times, "output": rises}],
                "channels": [
                    {"sampler": 0, "target": {"node": 1, "path": "rotation"}},
                    {"sampler": 1, "target": {"node": 2, "path": "weights"}},
                ],
            }
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    if path.suffix == ".gltf":
        path.with_name("a buffer.bin").write_bytes(blob)
        document["buffers"] = [{"byteLength": len(blob), "uri": "a%20buffer.bin"}]
        path.write_text(json.dumps(document))
        return path
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(blob)
    header = struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A)
    path.write_bytes(header + text + struct.pack("<II", len(blob), 0x004E4942) + blob)
    return path


def strip_at(time: float, offset: float = 0.0) -> np.ndarray:
    """The strip's corners by hand, (4, 3)."""
    share = min(max(time, 0.0), 1.0)
    cosine, sine = np.cos(share * np.pi / 2), np.sin(share * np.pi / 2)
    return np.array(
        [
            (0, 0, offset),
            (1, 0, offset),
            (-sine, 1 + cosine, offset),
            (cosine - sine, 1 + sine + cosine, offset + 0.5 * share),
        ]
    )


TIMES = (0.0, 0.25, 0.5, 1.0, 2.0)


@pytest.mark.parametrize("name", ["tiny.glb", "tiny.gltf"])
def test_validator_passes_a_sound_file(tmp_path: Path, name: str) -> None:
    (report,) = validate([tiny_glb(tmp_path / name)])
    assert (report.errors, report.warnings) == (0, 0), report.lines()


def test_validator_reports_each_file_on_its_own(tmp_path: Path) -> None:
    sound, broken = validate([tiny_glb(tmp_path / "sound.glb"), tiny_glb(tmp_path / "broken.glb", top_joint=7)])
    assert sound.errors == 0
    assert broken.errors > 0
    assert all(line.startswith("broken.glb#/") for line in broken.lines())
    with pytest.raises(AssertionError, match="ACCESSOR_JOINTS_INDEX_OOB"):
        assert_valid(sound.path, broken.path)


@pytest.mark.parametrize("name", ["tiny.glb", "tiny.gltf"])
@pytest.mark.parametrize("offsets", [(0.0,), (0.0, -3.0)], ids=["one primitive", "two primitives"])
def test_three_poses_as_computed_by_hand(tmp_path: Path, name: str, offsets: tuple[float, ...]) -> None:
    path = tiny_glb(tmp_path / name, offsets=offsets)
    expected = np.array([np.concatenate([strip_at(time, offset) for offset in offsets]) for time in TIMES])
    assert compare_with_three(path, "strip", "wave", TIMES, expected) < 1e-6


def test_three_normals_are_morphed_then_skinned(tmp_path: Path) -> None:
    _, normals = pose_with_normals(tiny_glb(tmp_path / "tiny.glb"), node=2, clip=0, times=[0, 1])
    assert normals[0] == pytest.approx(np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert normals[1, 3] == pytest.approx(np.array([-1, 0, 1]) / 2**0.5, abs=1e-6)


def test_vertices_and_no_clip(tmp_path: Path) -> None:
    path = tiny_glb(tmp_path / "tiny.glb", offsets=(0.0, 5.0))
    found = pose(path, node="strip", clip=None, times=[0.0], vertices=[7, 2])
    assert found[0] == pytest.approx(np.array([(1, 2, 5), (0, 2, 0)]))


def test_a_difference_is_said_where(tmp_path: Path) -> None:
    expected = np.array([strip_at(0.5)])
    expected[0, 2, 1] += 1e-4
    with pytest.raises(AssertionError, match=r"tiny\.glb: 0\.0001 > .* at time 0\.5, vertex 2"):
        compare_with_three(tiny_glb(tmp_path / "tiny.glb"), "strip", "wave", [0.5], expected)


def test_an_unknown_clip_is_said(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match='no clip "wav"'):
        pose(tiny_glb(tmp_path / "tiny.glb"), node="strip", clip="wav", times=[0.0])


@pytest.mark.slow
def test_node_is_started_again_where_it_gave_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tiny_glb(tmp_path / "tiny.glb")
    with monkeypatch.context() as hasty:
        hasty.setattr(clients, "PATIENCE", 0.0)
        with pytest.raises(AssertionError, match=r"validate\.mjs: no answer within 0 s"):
            validate([path])
    assert_valid(path)
