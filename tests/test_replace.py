"""`wrinkle bake --replace`: wrinkles of an earlier bake give way to new ones."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_encode import (
    BACK,
    BROW,
    PALM,
    Editor,
    Gltf,
    Json,
    aside,
    bystanders,
    edited,
    sample,
    shared_mesh,
    sharp_keys,
    spline_keys,
    two_meshes,
    two_parts,
    without_normals,
    write_tools,
)

import wrinklecli
from clients import assert_valid
from wrinklecli import cli
from wrinklecli.config import Length
from wrinklecli.document import read_document
from wrinklecli.errors import BakeError
from wrinklecli.restore import without_wrinkles

FINER: Json = {**PALM, "name": "other", "strategy": "both_ends", "bumps": 4, "width": 0.05}
KNEE: Json = {"name": "knee", "origin": [0.104, 0.635, -0.091], "target": [0.104, 0.365, -0.084], "width": 0.24}


def bake(asset: Path, out: Path, *tools: Json, top: Json | None = None, **options: Any) -> Path:
    file = write_tools(out.parent / "tools.yaml", *tools, **(top or {}))
    wrinklecli.bake(asset, file, out, **{"max_levels": 0, "max_error": Length(5.0, percent=True), **options})
    return out


@pytest.mark.parametrize(
    ("asset", "first", "second"),
    [
        (lambda: sample("wrist"), [PALM, BACK], [FINER]),
        (lambda: sample("wrist"), [FINER], [FINER]),
        (lambda: sample("trousers"), [KNEE, {**KNEE, "name": "again"}], [{**KNEE, "bumps": 2}]),
        (lambda: edited("wrist", bystanders), [PALM], [FINER]),
        (lambda: edited("wrist", two_parts), [PALM], [FINER]),
        (lambda: edited("wrist", without_normals), [PALM], [FINER]),
        (lambda: edited("wrist", shared_mesh), [aside(PALM)], [aside(FINER)]),
        (lambda: edited("wrist", two_meshes), [{**PALM, "node": "wrist"}, aside(BACK)], [aside(FINER)]),
        (lambda: sample("wrist"), [{**PALM, "attachment": "patch"}, BACK], [FINER]),
    ],
)
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_same_bytes_as_from_the_original(
    asset: Callable[[], Path], first: list[Json], second: list[Json], ending: str, tmp_path: Path
) -> None:
    direct, replaced = tmp_path / "direct", tmp_path / "replaced"
    for folder in (direct, replaced):
        folder.mkdir()
    earlier = bake(asset(), tmp_path / f"earlier.{ending}", *first)
    bake(asset(), direct / f"out.{ending}", *second)
    bake(earlier, replaced / f"out.{ending}", *second, replace=True)
    if ending == "glb":
        assert (direct / "out.glb").read_bytes() == (replaced / "out.glb").read_bytes()
    assert_same(Gltf(direct / f"out.{ending}"), Gltf(replaced / f"out.{ending}"))


def assert_same(one: Gltf, other: Gltf) -> None:
    """Of a .gltf the buffers' files may be cut elsewhere."""
    assert {k: v for k, v in one.json.items() if k not in ("buffers", "bufferViews")} == {
        k: v for k, v in other.json.items() if k not in ("buffers", "bufferViews")
    }
    for index in range(len(one.json["accessors"])):
        assert np.array_equal(one.stored(index), other.stored(index))


def test_a_rest_pose_of_its_own_leaves_no_weights_behind(tmp_path: Path) -> None:
    top = {"rest": {"clip": "extend", "time": 1.0}}
    earlier = bake(sample("wrist"), tmp_path / "earlier.glb", PALM, top=top)
    assert "weights" in Gltf(earlier).json["nodes"][0]
    direct = bake(sample("wrist"), tmp_path / "direct.glb", FINER)
    assert bake(earlier, tmp_path / "out.glb", FINER, replace=True).read_bytes() == direct.read_bytes()


@pytest.mark.parametrize("change", [None, sharp_keys, spline_keys])
def test_old_morph_targets_move_as_before(change: Callable[[Editor], None] | None, tmp_path: Path) -> None:
    asset = sample("head") if change is None else edited("head", change)
    earlier = bake(asset, tmp_path / "earlier.glb", BROW)
    out = bake(earlier, tmp_path / "out.glb", {**BROW, "name": "new", "strategy": "origin"}, replace=True)
    before, after = Gltf(asset), Gltf(out)
    names = after.mesh("head")["extras"]["targetNames"]
    assert names[:2] == before.mesh("head")["extras"]["targetNames"]
    assert all(name.startswith("wrinkle_new_") for name in names[2:])
    times = np.linspace(0, 2, 301)
    was, now = (file.weights("head", "raise_brows", times) for file in (before, after))
    jumps = np.zeros(len(times), bool)
    if change is sharp_keys:
        jumps = (np.abs(times[:, None] - [0.5, 1.25, 2.0]) < 1e-6).any(axis=1)
    assert np.abs(now[:, :2] - was)[~jumps].max() < 2e-6
    assert out.stat().st_size < earlier.stat().st_size + 200_000
    assert_valid(out)


def test_what_is_left_is_the_original(tmp_path: Path) -> None:
    earlier = bake(sample("trousers"), tmp_path / "earlier.glb", KNEE)
    restored, original = without_wrinkles(read_document(earlier)), read_document(sample("trousers"))
    for key in original.gltf:
        if key != "buffers":
            assert restored.gltf[key] == original.gltf[key], key
    assert bytes(restored.buffers[0])[: len(original.buffers[0])] == bytes(original.buffers[0])
    assert len(restored.buffers[0]) - len(original.buffers[0]) < 4


def test_refined_meshes_are_refused(tmp_path: Path) -> None:
    earlier = bake(sample("wrist"), tmp_path / "earlier.glb", PALM, max_levels=2)
    out = tmp_path / "out.glb"
    with pytest.raises(BakeError, match=r"earlier\.glb#/nodes/0.*refined.*original"):
        bake(earlier, out, FINER, replace=True)
    with pytest.raises(BakeError, match="--replace"):
        bake(earlier, out, FINER)
    assert not out.exists()


def test_an_asset_without_wrinkles_bakes_as_ever(tmp_path: Path) -> None:
    one, other = (bake(sample("wrist"), tmp_path / f"{k}.glb", PALM, replace=bool(k)) for k in (0, 1))
    assert one.read_bytes() == other.read_bytes()


def test_the_input_is_left_as_it_was(tmp_path: Path) -> None:
    earlier = bake(sample("wrist"), tmp_path / "earlier.glb", PALM)
    kept = shutil.copy(earlier, tmp_path / "copy.glb")
    with pytest.raises(BakeError, match="overwritten"):
        bake(earlier, earlier, FINER, replace=True)
    assert earlier.read_bytes() == Path(kept).read_bytes()


def test_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    earlier = bake(sample("wrist"), tmp_path / "earlier.glb", PALM)
    direct = bake(sample("wrist"), tmp_path / "direct.glb", FINER)
    monkeypatch.chdir(tmp_path)
    options = [
        "bake",
        str(earlier),
        "tools.yaml",
        "-o",
        "out.glb",
        "--replace",
        "--max-levels",
        "0",
        "--max-error",
        "5%",
    ]
    monkeypatch.setattr(sys, "argv", ["wrinkle", *options, "-q"])
    cli.main()
    assert (tmp_path / "out.glb").read_bytes() == direct.read_bytes()


def test_replacing_again_and_again_leaves_nothing_behind(tmp_path: Path) -> None:
    sizes = []
    file = bake(sample("head"), tmp_path / "0.glb", BROW)
    for number in range(1, 4):
        file = bake(file, tmp_path / f"{number}.glb", BROW, replace=True)
        sizes.append(file.stat().st_size)
    assert sizes[0] == sizes[1] == sizes[2]
    assert sizes[0] < (tmp_path / "0.glb").stat().st_size + 2000


def test_only_tracks_that_a_bake_has_added_go(tmp_path: Path) -> None:
    def without_weights(editor: Editor) -> None:
        """The clip think leaves the morph targets alone."""
        editor.json["animations"][1]["channels"].pop()

    for asset, count in ((sample("head"), 3), (edited("head", without_weights), 2)):
        earlier = bake(asset, tmp_path / "earlier.glb", BROW)
        assert len(Gltf(earlier).clip("think")["channels"]) == 3
        restored = without_wrinkles(read_document(earlier)).gltf
        assert len(restored["animations"][1]["channels"]) == count
