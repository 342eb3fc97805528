"""The sample driver: it gives clips that were never baked the weights that baking gives them."""

from pathlib import Path

import numpy as np
import pytest
from test_encode import BROW, ROOT, Editor, Gltf, Json, bake_config, bake_once

from clients import drive, optimize

# The table's own straight lines, and what eight digits and float32 add where a height starts.
TABLE = 1 / 256 + 1e-3


def test_the_sample_is_small() -> None:
    lines = [len((ROOT / "samples" / "driver" / name).read_text().splitlines()) for name in ("index.html", "driver.js")]
    assert sum(lines) < 150


@pytest.mark.parametrize(
    ("name", "config", "clip"),
    [
        ("wrist", "wrist", "flex"),
        ("wrist", "wrist", "extend"),
        ("trousers", "trousers", "squat"),
        ("trousers", "trousers", "walk"),
        ("head", "head", "raise_brows"),
    ],
)
def test_a_driven_clip_looks_as_if_it_were_baked(name: str, config: str, clip: str) -> None:
    bare, whole = bake_config(name, config, tracks="none"), bake_config(name, config)
    assert_driven(bare, whole, name, clip)


def assert_driven(bare: Gltf, whole: Gltf, node: str, clip: str, tolerance: float = TABLE) -> None:
    """The driver's weights on one file are the tracks of another, at their keys."""
    times, values = whole.keys(clip, node)
    names = whole.mesh(node)["extras"]["targetNames"]
    driven = drive(bare.path, node=node, clip=clip, times=times.tolist(), driver=True)
    assert set(driven) == set(names)
    wrinkles = [k for k, each in enumerate(names) if each.startswith("wrinkle_")]
    assert wrinkles
    for k in wrinkles:
        error = np.abs(driven[names[k]] - values[:, [k]])
        assert error.max() < tolerance, (names[k], times[error.max(axis=1).argmax()], error.max())


def other_bind_space(editor: Editor) -> None:
    """Inverse bind matrices as after quantisation, which takes positions to another space."""
    for skin in editor.json["skins"]:
        accessor = editor.json["accessors"][skin["inverseBindMatrices"]]
        start = editor.json["bufferViews"][accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
        old = np.frombuffer(bytes(editor.data), "<f4", 16 * accessor["count"], start).reshape(-1, 4, 4)
        wider = np.diag(np.float32([3.0, 3.0, 3.0, 1.0]))
        wider[3, :3] = [0.1, -0.2, 0.3]
        editor.data[start : start + old.nbytes] = np.float32(wider @ old).tobytes()


def test_quantised_positions_do_not_matter(tmp_path: Path) -> None:
    editor = Editor(Gltf(bake_config("trousers", "trousers", tracks="none").path))
    other_bind_space(editor)
    bare = Gltf(editor.save(tmp_path / "quantised.glb"))
    assert_driven(bare, bake_config("trousers", "trousers"), "trousers", "squat")


@pytest.mark.parametrize(("name", "clip"), [("wrist", "flex"), ("trousers", "squat"), ("head", "raise_brows")])
def test_an_optimiser_may_have_been_over_the_file(name: str, clip: str, tmp_path: Path) -> None:
    """glTF-Transform with meshopt: positions are quantised, bind matrices others, clips resampled."""
    small = tmp_path / "small.glb"
    optimize(bake_config(name, name, tracks="none").path, small)
    # Rotations are stored in 16 bits, which counts where a height starts like a square root.
    assert_driven(Gltf(small), bake_config(name, name), name, clip, TABLE + 0.005)


@pytest.mark.parametrize(
    "rest_length",
    [
        {"morph": "browsUp", "full": "115%"},
        {"keys": {"think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]], "raise_brows": [[0, "110%"]]}},
    ],
)
def test_rest_lengths_that_a_morph_target_or_keys_drive(rest_length: Json) -> None:
    tool: Json = {**BROW, "rest_length": rest_length, "clips": {"raise_brows": 0.5}}
    bare, whole = (bake_once("head", tool, tracks=tracks) for tracks in ("none", "all"))
    for clip in ("raise_brows", "think"):
        assert_driven(bare, whole, "head", clip)
