"""Files of posed frames: their contents, and a folder that gets all of them or none."""

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.bakes import COARSE, bake_once
from kit.command import files
from kit.limb import write_tools
from kit.samples import BACK, PALM, Editor, aside, edited, one_moves, sample
from wrinklecli.baking import frame_files
from wrinklecli.baking.frames import PosedFrame
from wrinklecli.errors import WrinkleError
from wrinklecli.files.outputs import Outputs
from wrinklecli.numeric.arrays import unit


def read_frame(path: Path) -> Any:
    import trimesh  # 0.4 s of each worker, if it were at the top

    loaded: Any = trimesh.load(path, process=False)
    return loaded.to_geometry() if isinstance(loaded, trimesh.Scene) else loaded


@pytest.mark.quick(1)
@pytest.mark.parametrize("kind", ["obj", "ply", "glb"])
def test_a_file_for_each_frame(kind: str, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    folder = tmp_path / "a" / "frames"
    wrinklecli.bake(sample("wrist"), tools, frames_dir=folder, frames_format=kind, mode="frames", fps=4, **COARSE)
    morphed = bake_once("wrist", PALM, fps=4)
    times = np.linspace(0, 2, 9)
    names = [f"{clip}_{k:04d}.{kind}" for clip in ("extend", "flex") for k in range(len(times))]
    found = sorted(path.name for path in folder.iterdir() if path.suffix == f".{kind}")
    assert found == names
    for clip in ("flex", "extend"):
        posed = morphed.pose("wrist", clip, times)
        for k in range(0, len(times), 2):
            mesh = read_frame(folder / f"{clip}_{k:04d}.{kind}")
            if kind == "obj":
                # trimesh splits OBJ vertices by corner, and may put them in another order.
                corners = posed[k][morphed.triangles("wrist")]
                assert mesh.faces.shape == corners.shape[:2]
                assert np.abs(mesh.vertices[mesh.faces] - corners).max() < 1e-6
                u, v = morphed.attribute("wrist", "TEXCOORD_0")[morphed.triangles("wrist")].transpose(2, 0, 1)
                assert np.abs(mesh.visual.uv[mesh.faces] - np.stack([u, 1.0 - v], axis=2)).max() < 1e-6
            else:
                assert np.abs(mesh.vertices - posed[k]).max() < 1e-6
                assert np.array_equal(mesh.faces, morphed.triangles("wrist"))


@pytest.mark.slow
def test_files_beside_morph_targets(tmp_path: Path) -> None:
    palm = {**PALM, "variation": 0}  # its tracks have a key at each of the times
    tools = write_tools(tmp_path / "tools.yaml", palm)
    frames = {"frames_dir": tmp_path / "f", "frames_format": "ply", "fps": 4}
    wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb", **frames, **COARSE)
    reference = bake_once("wrist", palm, fps=4)
    assert (tmp_path / "out.glb").read_bytes() == reference.path.read_bytes()
    frames = sorted((tmp_path / "f").glob("flex_*.ply"))
    assert len(frames) == 9
    posed = reference.pose("wrist", "flex", np.linspace(0, 2, 9))
    for path, wanted in zip(frames, posed, strict=True):
        assert np.abs(read_frame(path).vertices - wanted).max() < 1e-6


@pytest.mark.parametrize("with_normals", [True, False])
@pytest.mark.parametrize("with_uvs", [True, False])
def test_obj_files_are_trimesh_s_without_its_materials(with_normals: bool, with_uvs: bool) -> None:
    chance = np.random.default_rng(1)
    triangles, uvs = np.array([[0, 1, 2], [2, 1, 3]]), chance.random((4, 2)) if with_uvs else None
    write = frame_files._obj_writer(triangles, uvs)
    for _ in range(3):
        normals = unit(chance.normal(size=(4, 3))) if with_normals else None
        posed = [PosedFrame(chance.random((4, 3)), normals, None)]
        whole = frame_files._exported(posed, triangles, uvs, "obj").decode().splitlines()
        assert write(posed).decode().splitlines() == [
            line for line in whole if not line.startswith(("mtllib", "usemtl"))
        ]


@pytest.mark.slow
def test_obj_files_have_their_coordinates_and_normals(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    wrinklecli.bake(sample("wrist"), tools, frames_dir=tmp_path, mode="frames", fps=1, clips=["flex"], **COARSE)
    lines = (tmp_path / "flex_0001.obj").read_text().splitlines()
    counts = {kind: sum(line.startswith(f"{kind} ") for line in lines) for kind in ("v", "vn", "vt", "f")}
    morphed = bake_once("wrist", PALM, fps=1)
    assert counts["v"] == len(morphed.attribute("wrist", "POSITION"))
    assert counts["f"] == len(morphed.triangles("wrist"))
    assert counts["vn"] > 0
    assert counts["vt"] > 0
    coordinates = np.array([line.split()[1:3] for line in lines if line.startswith("vt ")], float)
    wanted = morphed.attribute("wrist", "TEXCOORD_0") * [1, -1] + [0, 1]
    assert np.abs(np.unique(coordinates.round(5), axis=0) - np.unique(wanted.round(5), axis=0)).max() < 2e-5


def renamed(editor: Editor) -> None:
    """Clips whose names differ only in characters that a file name may not have."""
    for animation, name in zip(editor.json["animations"], ("a b", "a/b"), strict=True):
        animation["name"] = name


def test_clips_with_odd_names_do_not_overwrite_each_other(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    folder = tmp_path / "frames"
    wrinklecli.bake(edited("wrist", renamed), tools, frames_dir=folder, frames_format="ply", mode="frames", fps=2)
    assert len(list(folder.iterdir())) == 10
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames", "tools.yaml"]


def collide(editor: Editor) -> None:
    """Clips whose names are one without such characters, and one that has the name by which these are told apart."""
    clips = editor.json["animations"]
    clips[:] = [clips[0] | {"name": "x?"}, clips[0] | {"name": "x__2"}, clips[1] | {"name": "x!"}]


def test_clips_whose_files_would_have_one_name(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    folder = tmp_path / "frames"
    wrinklecli.bake(edited("wrist", collide), tools, frames_dir=folder, frames_format="ply", mode="frames", fps=2)
    stems = {path.name.rpartition("_")[0] for path in folder.iterdir()}
    assert stems == {"x_", "x__2", "x__2_2"}


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["flex_0000.glb", "extend_0002.glb"])
@pytest.mark.parametrize("output", ["asset", "OUT"])
def test_frames_are_never_written_over_the_asset_or_the_output(name: str, output: str, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    asset, out = (tmp_path / name, tmp_path / "out.glb") if output == "asset" else (tmp_path / "a.glb", tmp_path / name)
    shutil.copy(sample("wrist"), asset)
    before = files(tmp_path)
    with pytest.raises(WrinkleError, match=f"{name}: is an"):
        wrinklecli.bake(asset, tools, out, frames_dir=tmp_path, frames_format="glb", mode="frames", fps=2)
    assert files(tmp_path) == before


@pytest.mark.slow
def test_files_of_two_meshes_of_which_a_clip_moves_one(tmp_path: Path) -> None:
    """Every file holds both meshes, the still one as stored."""
    tools = write_tools(tmp_path / "tools.yaml", {**PALM, "node": "wrist"}, aside(BACK))
    folder = tmp_path / "frames"
    wrinklecli.bake(edited("wrist", one_moves), tools, frames_dir=folder, frames_format="ply", mode="frames", fps=2)
    assert len(list(folder.glob("flex_*.ply"))) == len(list(folder.glob("extend_*.ply"))) == 5
    for path in folder.iterdir():
        vertices = read_frame(path).vertices
        assert vertices[:, 2].min() < 0 < 0.9 < vertices[:, 2].max()


@pytest.mark.quick(1)
@pytest.mark.parametrize("there", [False, True])
def test_no_partial_folder(there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    folder = tmp_path / "frames"
    if there:
        folder.mkdir()
        (folder / "flex_0000.obj").write_text("old")
    add, written = Outputs.add, []

    def full(self: Outputs, path: str, write: Any, **options: Any) -> int:
        def write_until_full(file: Any) -> None:
            written.append(path)
            if len(written) > 3:
                raise OSError(28, "No space left on device")
            write(file)

        return add(self, path, write_until_full, **options)

    monkeypatch.setattr(Outputs, "add", full)
    with pytest.raises(WrinkleError, match="No space left on device"):
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb", frames_dir=folder, mode="frames", fps=4)
    monkeypatch.undo()
    assert len(written) == 4
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())
    assert left == (["frames/flex_0000.obj", "tools.yaml"] if there else ["tools.yaml"])
    if there:
        assert (folder / "flex_0000.obj").read_text() == "old"


def test_no_frames_where_the_output_cannot_be_written(tmp_path: Path) -> None:
    """Both or none."""
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    with pytest.raises(WrinkleError):
        wrinklecli.bake(
            sample("wrist"),
            tools,
            tmp_path / "absent" / "out.glb",
            frames_dir=tmp_path / "frames",
            mode="frames",
            fps=2,
        )
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["tools.yaml"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    with pytest.raises(WrinkleError) as caught:
        wrinklecli.bake(sample("wrist"), tools, frames_dir=tools, mode="frames", fps=2)
    (line,) = caught.value.lines
    assert line.startswith(f"{tools}: cannot be written")


@pytest.mark.quick(1)
@pytest.mark.parametrize("fails", ["a file", "OUT"])
def test_frames_that_fail_half_way_leave_all_as_it_was(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those already in place are taken back, and what they replaced returns."""
    tools, out, folder = write_tools(tmp_path / "tools.yaml", PALM), tmp_path / "out.glb", tmp_path / "frames"
    folder.mkdir()
    out.write_bytes(b"old")
    (folder / "flex_0001.obj").write_bytes(b"old frame")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    real = os.replace

    def replace(source: Any, target: Any) -> None:
        if Path(target) == (folder / "flex_0003.obj" if fails == "a file" else out):
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(WrinkleError, match="No space left"):
        wrinklecli.bake(sample("wrist"), tools, out, max_levels=0, fps=4, frames_dir=folder, clips=["flex"])
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert [path.name for path in folder.iterdir()] == ["flex_0001.obj"]


def test_folders_above_the_frames_are_taken_away_too(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    with pytest.raises(WrinkleError):
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "missing" / "out.glb", max_levels=0, fps=4, clips=["flex"],
                        frames_dir=tmp_path / "a" / "b")  # fmt: skip
    assert [path.name for path in tmp_path.iterdir()] == ["tools.yaml"]
