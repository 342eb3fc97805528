"""The bundled samples: made anew byte for byte, and as well built as their page says."""

import io
import json
import os
import shutil
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

import contact_picture
from _characters import Character, Joint, to_glb
from _figure import base_colour, encode_png
from _shapes import Mesh
from kit.command import make_samples
from kit.places import SAMPLES
from wrinklecli import bake

ROOT = Path(__file__).parents[2]
NAMES = ("wrist", "head", "trousers", "body", "touch", "figure")
TRIANGLES = {"wrist": 2480, "head": 21267, "trousers": 6362, "body": 19124, "touch": 2886, "figure": 21856}
BORDERS = {"wrist": 1, "head": 1, "trousers": 3, "body": 0, "touch": 2, "figure": 0}
PIECES = {"touch": 2}  # one without an entry
CLIPS = {
    "wrist": ["flex", "extend"],
    "head": ["raise_brows", "think"],
    "trousers": ["squat", "walk"],
    "body": ["jump", "walk", "curl"],
    "touch": ["drag"],
    "figure": ["squat", "walk"],
}
DTYPES = {5121: np.uint8, 5123: np.uint16, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass(frozen=True)
class Sample:
    document: dict[str, Any]
    data: bytes

    def array(self, accessor: int) -> NDArray[Any]:
        described = self.document["accessors"][accessor]
        view = self.document["bufferViews"][described["bufferView"]]
        width = WIDTHS[described["type"]]
        flat = np.frombuffer(
            self.data, DTYPES[described["componentType"]], described["count"] * width, view["byteOffset"]
        )
        return flat.reshape(-1, width)

    @property
    def primitive(self) -> dict[str, Any]:
        return self.document["meshes"][0]["primitives"][0]

    def attribute(self, name: str) -> NDArray[Any]:
        return self.array(self.primitive["attributes"][name])

    @property
    def triangles(self) -> NDArray[np.intp]:
        return self.array(self.primitive["indices"]).astype(np.intp).reshape(-1, 3)

    def welded(self) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
        """Positions and triangles of welded vertices, and the welded vertex of each glTF vertex."""
        positions, inverse = np.unique(self.attribute("POSITION"), axis=0, return_inverse=True)
        inverse = inverse.ravel()
        return positions.astype(np.float64), inverse[self.triangles], inverse


@cache
def sample(name: str) -> Sample:
    return read(path_of(name))


def path_of(name: str) -> Path:
    return (ROOT / "wrinklecli" / "example" if name == "figure" else SAMPLES) / f"{name}.glb"


def read(path: Path) -> Sample:
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return Sample(json.loads(content[20 : 20 + length]), content[28 + length :])


def edges(triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


@pytest.mark.slow
@pytest.mark.long
def test_generator_makes_the_committed_files_byte_for_byte(tmp_path: Path) -> None:
    subprocess.run([sys.executable, str(SAMPLES / "make_samples.py"), str(tmp_path)], check=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(f"{name}.glb" for name in NAMES)
    for name in NAMES:
        made, kept = (parts_of(path) for path in (tmp_path / f"{name}.glb", path_of(name)))
        assert made == kept, f"{name}.glb: run samples/make_samples.py and commit its output"


def parts_of(path: Path) -> tuple[bytes, ...]:
    """The bytes of a file; where it has a picture, its pixels, since each zlib packs them in its own way."""
    made = read(path)
    if "images" not in made.document:
        return (path.read_bytes(),)
    view = made.document["bufferViews"].pop()  # the last
    made.document["buffers"] = None
    packed = made.data[view["byteOffset"] :][: view["byteLength"]]
    with Image.open(io.BytesIO(packed)) as picture:
        return json.dumps(made.document).encode(), made.data[: view["byteOffset"]], picture.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_counts_and_clips(name: str) -> None:
    made = sample(name)
    assert len(made.triangles) == TRIANGLES[name]
    assert path_of(name).stat().st_size < 2_000_000
    assert [clip["name"] for clip in made.document["animations"]] == CLIPS[name]
    assert made.document["asset"]["generator"] == "wrinkle samples"
    assert all(node["name"] for node in made.document["nodes"])


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", NAMES)
def test_surface_is_manifold_with_the_stated_borders(name: str) -> None:
    positions, triangles, _ = sample(name).welded()
    directed = edges(triangles)
    assert len(np.unique(directed, axis=0)) == len(directed), "duplicate triangle or inconsistent winding"
    undirected, uses = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    assert uses.max() == 2
    # A border that is a set of closed loops has as many edges as vertices, each vertex with two.
    border = undirected[uses == 1]
    corners, degrees = np.unique(border, return_counts=True)
    assert np.array_equal(degrees, np.full(len(corners), 2))
    assert len(loops(border)) == BORDERS[name]
    pieces = PIECES.get(name, 1)
    assert len(loops(undirected)) == pieces
    # A sphere with k holes has V - E + F = 2 - k.
    assert len(positions) - len(undirected) + len(triangles) == 2 * pieces - BORDERS[name]


def loops(pairs: NDArray[np.intp]) -> set[int]:
    """Representatives of the connected components of a graph."""
    parents = {int(vertex): int(vertex) for vertex in np.unique(pairs)}

    def root(vertex: int) -> int:
        while parents[vertex] != vertex:
            parents[vertex] = parents[parents[vertex]]
            vertex = parents[vertex]
        return vertex

    for a, b in pairs.tolist():
        parents[root(a)] = root(b)
    return {root(vertex) for vertex in parents}


@pytest.mark.parametrize("name", NAMES)
def test_triangles_are_well_shaped(name: str) -> None:
    positions, triangles, _ = sample(name).welded()
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    sides = np.sort([np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    smallest_angles = np.degrees(np.arcsin(2.0 * areas / (sides[1] * sides[2])))
    assert smallest_angles.min() > 15.0
    assert sides.min() > 0.001


@pytest.mark.parametrize("name", NAMES)
def test_texture_seams_split_vertices_that_agree_in_all_else(name: str) -> None:
    made = sample(name)
    positions, _, inverse = made.welded()
    assert len(inverse) > 1.01 * len(positions)
    first = np.full(len(positions), len(inverse))
    np.minimum.at(first, inverse, np.arange(len(inverse)))
    for attribute in ("POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0"):
        values = made.attribute(attribute)
        assert np.array_equal(values, values[first[inverse]])
    uvs = made.attribute("TEXCOORD_0")
    assert not np.array_equal(uvs, uvs[first[inverse]])
    assert uvs.min() >= 0.0
    assert uvs.max() <= 1.0


@pytest.mark.parametrize("name", NAMES)
def test_weights_sum_to_one(name: str) -> None:
    made = sample(name)
    weights = made.attribute("WEIGHTS_0").astype(np.float64)
    assert weights.min() >= 0.0
    assert np.abs(weights.sum(axis=1) - 1.0).max() < 1e-7
    assert made.attribute("JOINTS_0").max() < len(made.document["skins"][0]["joints"])


@pytest.mark.parametrize("name", ["head", "trousers"])
def test_left_and_right_mirror_each_other(name: str) -> None:
    positions, _, _ = sample(name).welded()
    mirror_images = np.unique(positions * [-1.0, 1.0, 1.0] + 0.0, axis=0)
    assert np.array_equal(np.unique(positions + 0.0, axis=0), mirror_images)


def test_brows_move_smoothly_and_nothing_else_does() -> None:
    made = sample("head")
    assert made.document["meshes"][0]["extras"]["targetNames"] == ["browsUp", "browsDown"]
    positions = made.attribute("POSITION")
    for target, sign in zip(made.primitive["targets"], (1.0, -1.0), strict=True):
        offsets = made.array(target["POSITION"]).astype(np.float64)
        moved = np.linalg.norm(offsets, axis=1) > 1e-6
        assert positions[moved, 1].min() > 0.19
        assert positions[moved, 1].max() < 0.3
        assert (sign * offsets[:, 1]).max() > 0.005
        before, after = (face_normals(moment, made.triangles) for moment in (positions, positions + offsets))
        assert np.einsum("fi,fi->f", before, after).min() > 0.5, "a triangle turns by more than 60 degrees"


def face_normals(positions: NDArray[np.float64], triangles: NDArray[np.intp]) -> NDArray[np.float64]:
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1)[:, None]


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "config",
    [*sorted((ROOT / "configs").glob("*.yaml")), path_of("figure").with_suffix(".yaml")],
    ids=lambda path: path.stem,
)
def test_anchors_of_the_tools_files_lie_on_the_skin(config: Path) -> None:
    positions, triangles, _ = sample(config.stem.split("_")[0]).welded()
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    normals = face_normals(positions, triangles)
    for tool in yaml.safe_load(config.read_text()).get("tools", ()):
        for end in ("origin", "target"):
            point = np.array(tool[end])
            inside = np.ones(len(a), dtype=bool)
            for p, q in ((a, b), (b, c), (c, a)):
                # Over a convex edge a point projects onto neither triangle: a tenth of a millimetre of slack.
                across = np.einsum("fi,fi->f", np.cross(q - p, point - p), normals)
                inside &= across >= -1e-4 * np.linalg.norm(q - p, axis=1)
            heights = np.abs(np.einsum("fi,fi->f", point - a, normals))[inside]
            assert heights.min() < 0.001, f"{tool['name']}: {end} is {heights.min():.4f} m off"


def outputs(samples: Path) -> dict[str, int]:
    """Name and time of each baked file."""
    return {path.name: path.stat().st_mtime_ns for path in (samples / "out").glob("*.glb")}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_make_bakes_all_without_a_warning_and_again_only_what_changed(tmp_path: Path) -> None:
    samples, configs = tmp_path / "samples", tmp_path / "configs"
    shutil.copytree(SAMPLES, samples, ignore=shutil.ignore_patterns("out", "pictures", "__pycache__"))
    shutil.copytree(ROOT / "configs", configs)
    names = {f"{path.stem}.glb" for path in configs.glob("*.yaml")}

    first = make_samples(samples, "-j4")
    assert outputs(samples).keys() == names
    assert "warning" not in first.stderr

    # A minute into the past, so that what is touched or baked now is newer on any file system.
    minute_ago = time.time() - 60
    for path in [*configs.iterdir(), *samples.glob("*.glb"), *(samples / "out").iterdir()]:
        os.utime(path, (minute_ago, minute_ago))
    before = outputs(samples)
    make_samples(samples, "-q")
    make_samples(samples)
    assert outputs(samples) == before

    keyed = configs / "head_keyed.yaml"
    keyed.write_text(keyed.read_text().replace("refinement:", "refinement:\n  max_levels: 0"))
    make_samples(samples)
    after = outputs(samples)
    assert {name for name in names if after[name] != before[name]} == {"head_keyed.glb"}

    plain = configs / "head.yaml"
    plain.write_text(plain.read_text().replace("refinement:", "refinement:\n  max_levels: 0"))
    (samples / "head.glb").touch()
    make_samples(samples)
    assert {name for name, when in outputs(samples).items() if when != after[name]} == {"head.glb", "head_keyed.glb"}

    make_samples(samples, "clean")
    assert not (samples / "out").exists()


# --- What makes them ---


@pytest.mark.slow
@pytest.mark.parametrize("angle", [112.0, 117.5, 118.0, 120.0])
def test_contact_settles_in_the_elbow_of_its_picture(
    angle: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The solver knows no more than it may move: where the rest got to its places, poses were given up."""
    monkeypatch.setattr(contact_picture, "ANGLE", angle)
    (tmp_path / "arm.glb").write_bytes(to_glb(contact_picture.arm()))
    tools = {"version": 1, "refinement": {"max_levels": 2}, "tools": [{**contact_picture.ELBOW, "contact": "resolve"}]}
    (tmp_path / "tools.yaml").write_text(yaml.safe_dump(tools), encoding="utf-8")
    assert not bake(tmp_path / "arm.glb", tmp_path / "tools.yaml", tmp_path / "out.glb").warnings


def test_a_character_has_one_root() -> None:
    empty = Mesh(*(np.zeros((0, *shape)) for shape in ((3,), (4,), (4, 2), (3,), ())))
    joints = tuple(Joint(name, None, (0.0, 0.0, 0.0)) for name in ("hips", "hand"))
    with pytest.raises(ValueError, match=r": hips, hand$"):
        to_glb(Character("two", empty, joints, np.zeros((0, 2)), (), (1.0, 1.0, 1.0), "skin", 0.8))


@given(arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
def test_other_programs_read_a_picture_as_it_was_written(pixels: np.ndarray) -> None:
    with Image.open(io.BytesIO(encode_png(pixels))) as read:
        assert read.mode == "RGB"
        assert np.array_equal(np.array(read), pixels)


def test_the_texture_has_cloth_and_skin() -> None:
    with Image.open(io.BytesIO(base_colour(128))) as image:
        colours = np.array(image, int).reshape(-1, 3)
    red, _, blue = colours.T
    assert (blue > red + 40).mean() > 0.1, "denim"
    assert ((red > blue + 50) & (red > 150)).mean() > 0.02, "skin"
    assert (np.ptp(colours, axis=1) < 40).mean() > 0.05, "the shirt's white"
