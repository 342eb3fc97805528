"""A session of the editor, without a page: what it shows is what a bake writes, and every step can be undone."""

import json
import multiprocessing
import os
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path
from queue import Queue
from threading import Event
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

import wrinklecli
from kit.asset import Array
from kit.fields import sleeve, sleeve_and_field
from kit.flesh import body
from kit.folds import knees
from kit.limb import RADIUS, limb, limb_asset, sleeved_limb
from kit.work import PATIENCE
from wrinklecli.character.clip import read_clips
from wrinklecli.character.posing import with_pose
from wrinklecli.character.scene import read_scene
from wrinklecli.editor.asset import ReadOptions
from wrinklecli.editor.baked_file import BakedFile, RunningBake, SavedBake
from wrinklecli.editor.clicked import NEW_KINDS
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.session import Session
from wrinklecli.errors import AssetError, BakeError, ConfigError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.guard import log_progress
from wrinklecli.review.check import check
from wrinklecli.review.suggest.suggest import suggest

TOOLS = """\
version: 1
# Two on the inside of the fold, which overlap, and one far off.
tools:
  - name: crease
    origin: [-0.4, 0.25, 0.0]   # metres
    target: [0.4, 0.25, 0.0]
    width: 0.3
    bumps: 3
  - {name: across, origin: [-0.2, 0.2, 0.15], target: [0.2, 0.2, 0.15], width: 0.2, bumps: 2, material: skin}
  - {name: far, origin: [-0.9, -0.25, 0.0], target: [-0.7, -0.25, 0.0], width: 0.1, bumps: 2, rest_length: 120%}
"""


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A limb with three tools."""
    (tmp_path / "tools.yaml").write_text(TOOLS)
    return Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")


def baked_of(session: Session, folder: Path) -> BakedFile:
    """The baked file of what a session has saved, made in this process."""
    bake = SavedBake.of(session, str(folder / "cache"))
    return bake.read(bake.run())


@pytest.mark.slow
def test_what_is_shown_is_what_is_baked(session: Session, tmp_path: Path) -> None:
    session.set_value("far", ("strength",), 0.7)
    session.save()
    report = wrinklecli.bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb")
    bound = report.data["meshes"][0]["max_error"]
    document = read_document(tmp_path / "out.glb")
    (primitive,), (clip,) = read_scene(document), read_clips(document)
    for time in (0.0, 0.4, 1.0):
        (shown,) = session.meshes("fold", time)
        baked = primitive.positions_at(clip, time)
        assert len(primitive.triangles) == len(shown.faces)
        for some, others in ((shown.positions, baked), (baked, shown.positions)):
            assert cKDTree(others).query(some)[0].max() < bound


@pytest.mark.slow
def test_what_was_baked_is_shown_in_place_and_of_it_the_original_edited(session: Session, tmp_path: Path) -> None:
    session.save()
    baked = baked_of(session, tmp_path)
    assert baked.text == session.text
    assert [baked.plays(clip) for clip in (POSE, None, "fold")] == [False, True, True]
    (edited,), (written,) = session.meshes("fold", 0.4), baked.meshes("fold", 0.4)
    tallest = max(tool.attached.greatest_height for tool in session.attached_tools().values())
    assert len(written.faces) == len(edited.faces)
    assert cKDTree(written.positions).query(edited.positions)[0].max() < 0.01 * tallest
    out = tmp_path / "limb_wrinkled.glb"
    again = Session(out, tmp_path / "tools.yaml")
    assert again.notes == [f"{out}: is the output of a bake: its original is shown, and baked anew"]
    assert [tool.problem for tool in again.tools()] == [None] * 3
    baked_of(again, tmp_path)
    assert (tmp_path / "limb_wrinkled_wrinkled.glb").read_bytes() == out.read_bytes()


@pytest.mark.slow
def test_a_bake_in_a_process_of_its_own_ends_with_a_file_or_its_fault_or_is_cancelled(
    session: Session, tmp_path: Path
) -> None:
    session.save()
    found, bake = Queue[BakedFile | WrinkleError](), SavedBake.of(session, str(tmp_path / "cache"))
    stages = list[str]()
    RunningBake(bake, lambda *step: stages.append(step[0]), found.put)
    baked = found.get(timeout=PATIENCE)
    assert isinstance(baked, BakedFile)
    assert baked.text == session.text
    assert "sampling" in stages
    written = Path(bake.out).read_bytes()

    RunningBake(replace(bake, asset=str(tmp_path / "none.glb")), log_progress, found.put)
    fault = found.get(timeout=PATIENCE)
    assert isinstance(fault, WrinkleError)
    assert fault.lines[0].startswith(f"{tmp_path / 'none.glb'}: ")

    begun = Event()
    running = RunningBake(bake, lambda *_: begun.set(), found.put)
    assert begun.wait(PATIENCE)
    (process,) = multiprocessing.active_children()
    running.cancel()
    # Another thread may be fetching how it ended, and then `is_alive` does not know yet.
    assert wait([process.sentinel], PATIENCE)
    assert found.empty()
    assert Path(bake.out).read_bytes() == written
    assert not [*tmp_path.glob(".wrinkle-*")]


def test_an_asset_of_which_nothing_deforms_says_so(tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb", rings=7, sides=6, skinned=False, clip=None))
    assert session.notes[0] == f"{session.asset}: no mesh deforms: it has neither a skin nor morph targets"


@pytest.mark.slow
def test_a_bake_solves_no_fold_again_that_has_not_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    from wrinklecli.effects.contact import sample

    solve, solved = sample._solved_system, list[object]()

    def logged(members: Any, **options: Any) -> Any:
        solved.append(members)
        return solve(members, **options)

    monkeypatch.setattr(sample, "_solved_system", logged)
    session = Session(*knees(inwards=0.0, angle=90.0, sides=8).write(tmp_path, contact="resolve"))
    first = baked_of(session, tmp_path)
    count = len(solved)
    assert count
    again = baked_of(session, tmp_path)
    assert len(solved) == count
    assert again.document.buffers == first.document.buffers


def test_an_asset_with_wrinkles_that_no_record_tells_of_is_shown_as_it_is(tmp_path: Path) -> None:
    asset = limb_asset(rings=7, sides=6)
    node = next(node for node in asset.gltf["nodes"] if "mesh" in node)
    node["extras"] = {"wrinkle": {}}
    (tmp_path / "tools.yaml").write_text(TOOLS)
    session = Session(asset.write(tmp_path / "limb.glb"), tmp_path / "tools.yaml")
    assert "the record of the original asset is missing" in session.notes[0]
    assert all("already carries wrinkles" in str(tool.problem) for tool in session.tools())


def test_a_free_pose_is_that_of_preview(session: Session, tmp_path: Path) -> None:
    pose = FreePose().with_turn("joint_1", "z", 50.0).with_turn("joint_1", "x", 20.0)
    session.take_pose(pose)
    (shown,), (stored,) = session.meshes(POSE, 0.0, wrinkled=False), session.meshes(None, 0.0, wrinkled=False)
    posed = with_pose(read_document(tmp_path / "limb.glb"), [("joint_1", "x", 20.0), ("joint_1", "z", 50.0)], [])
    (primitive,), clip = read_scene(posed), read_clips(posed)[-1]
    assert f"--pose {clip.name.replace(' ', ' --pose ')}" == pose.options
    there = primitive.positions_at(clip, 0.0)
    assert cKDTree(shown.positions).query(there)[0].max() < 1e-6
    assert session.curve("crease", POSE, 0.0) is not None
    assert session.heights("crease", POSE) is None
    with pytest.raises(AssetError, match="has no joint 'joint_9'"):
        session.take_pose(pose.with_turn("joint_9", "x", 1.0))
    session.take_pose(pose.with_turn("joint_1", "x", 0.0).with_turn("joint_1", "z", 0.0))
    assert np.array_equal(session.meshes(POSE, 0.0, wrinkled=False)[0].positions, stored.positions)


@pytest.mark.slow
def test_a_tool_between_two_places_wrinkles_at_once(session: Session) -> None:
    name = session.add("tools", [[-0.3, 0.2, -0.15], [0.3, 0.2, -0.15]])
    assert [tool.name for tool in session.tools()] == ["crease", "across", "far", name]
    assert session.tools()[-1].problem is None
    curve = session.curve(name, "fold", 1.0)
    assert curve is not None
    assert curve[:, 1].max() > 0.005
    anchors = [anchor.position for anchor in session.attached_tools()[name].region.anchors]
    assert np.linalg.norm(anchors, axis=1) == pytest.approx([np.hypot(RADIUS, 0.3)] * 2, rel=0.03)


def test_a_tool_where_nothing_folds_is_of_what_its_place_is_made_of(tmp_path: Path) -> None:
    asset = limb_asset(rings=20, sides=12)
    asset.gltf["materials"] = [{"name": "denim"}]
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    session = Session(asset.write(tmp_path / "limb.glb"), tmp_path / "tools.yaml")
    session.add("tools", [[-0.95, 0.25, 0.0], [-0.8, 0.25, 0.0]])
    (tool,) = session.tools()
    assert (tool.values["material"], tool.keys["profile"].source_words) == ("cloth", "material cloth")


@pytest.mark.slow
def test_every_step_can_be_undone_and_done_again(session: Session) -> None:
    for number in range(20):
        session.set_value("crease", ("bumps",), 4 + number % 2)
    session.copy("across")
    session.delete("across")
    session.rename("far", "further")
    after, steps = session.text, 0
    while session.undo():
        steps += 1
    assert (session.text, steps) == (TOOLS, 23)
    while session.redo():
        pass
    assert session.text == after


def test_what_slides_on_is_one_step_and_a_later_drag_another(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    for bumps in (4, 5, 6):
        session.set_value("crease", ("bumps",), bumps, slides=True)
    session.set_value("crease", ("gap",), 1, slides=True)
    assert session.undo()
    assert "bumps: 6" in session.text
    assert session.undo()
    assert (session.text, session.undo()) == (TOOLS, None)
    session.redo()
    for bumps in (3, 6, 3):  # back where it began: no step
        session.set_value("crease", ("bumps",), bumps, slides=True)
    session.set_value("far", ("bumps",), 3, slides=True)
    assert session.undo()
    monkeypatch.setattr("wrinklecli.editor.edits._SLIDE_SECONDS", 0.0)
    for bumps in (4, 5):
        session.set_value("crease", ("bumps",), bumps, slides=True)
    assert session.undo()
    assert "bumps: 4" in session.text


def test_a_tool_has_the_values_that_are_baked_and_says_what_a_reset_gives(session: Session) -> None:
    across = session.tools()[1]
    baked = session.settings().tools[1]
    assert (across.values["profile"], across.keys["profile"].source_words) == ("skin", "material skin")
    assert (across.values["profile"], across.values["variation"]) == (baked.profile, baked.variation)
    assert across.own == {"name", "origin", "target", "width", "bumps", "material"}
    assert session.inherited(across)["bumps"].source_words == "material skin"
    assert "width" not in session.inherited(across)
    session.unset("across", ("bumps",))
    assert session.tools()[1].values["bumps"] == session.settings().tools[1].bumps == 3


def test_a_draft_knows_the_presets_of_its_file(tmp_path: Path) -> None:
    own = TOOLS.replace("tools:", "presets: {cuff: {material: cloth, gap: 1}}\ntools:", 1)
    (tmp_path / "tools.yaml").write_text(own.replace("material: skin", "material: cuff"))
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")
    session.set_value("across", ("bumps",), 3, draft=True)
    across = session.tools()[1]
    assert [across.keys[key].source_words for key in ("bumps", "gap")] == ["own key", "material cuff"]


@pytest.mark.slow
def test_the_presets_of_a_file_are_taken_watched_and_kept(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(TOOLS)
    asset = limb(tmp_path / "limb.glb", rings=20, sides=12)
    studio = tmp_path / "studio.yaml"
    studio.write_text("felt: {material: cloth, gap: 1, bumps: 2}\n")
    options = ReadOptions(presets=[studio])
    session = Session(asset, tmp_path / "tools.yaml", options)
    assert session.text == TOOLS.replace("\ntools:", "\npresets: studio.yaml\ntools:")
    session.set_material("across", "felt")
    assert session.tools()[1].values["gap"] == 1
    session.set_value("across", ("gap",), 3, draft=True)
    raised = session.try_material("crease", "felt")
    assert raised is not None
    assert raised.attached.attached.tool.gap == 1
    session.save()
    for _ in range(2):
        session.refresh()
    assert not [note for note in session.notes if "on disk" in note], "this session wrote it"
    assert Session(asset, tmp_path / "tools.yaml", options).text == session.text, "it is named once"
    studio.write_text("felt: {material: cloth, gap: 2, bumps: 2}\n")
    os.utime(studio, ns=(1, 1))
    session.refresh()
    assert session.refresh()
    assert session.tools()[1].values["gap"] == 2
    assert session.notes[-1] == f"{studio}: has changed on disk, and was read again"
    studio.write_text("felt: {gap: x}\n")
    session.refresh()
    session.refresh()
    assert session.notes[-1] == f"{studio}:1: felt.gap: found x, expected a whole number from 0 to 64"
    assert session.tools()[1].values["gap"] == 2


def test_presets_that_the_tools_file_cannot_name_are_refused(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", rings=20, sides=12)
    (tmp_path / "in").mkdir()
    tools = tmp_path / "in" / "tools.yaml"
    studio = tmp_path / "studio.yaml"
    studio.write_text("felt: {material: cloth}\n")
    with pytest.raises(ConfigError, match=r"presets: found '../studio.yaml', expected a file below the folder"):
        Session(asset, tools, ReadOptions(presets=[studio]))
    named = Session(asset, tools, ReadOptions(presets=[studio], allow_external=True))
    assert "felt" in named.presets
    tools.write_text(TOOLS.replace("tools:", "presets: {cuff: {gap: 1}}\ntools:"))
    with pytest.raises(ConfigError, match=r"tools.yaml:3: presets: the file has presets of its own"):
        Session(asset, tools, ReadOptions(presets=[studio], allow_external=True))


@pytest.mark.slow
def test_the_peak_of_a_tool_is_that_of_a_review(session: Session) -> None:
    raised, heights = session.raised("crease"), session.heights("crease", "fold")
    assert raised is not None
    assert heights is not None
    assert (raised.clip.name, raised.height) == ("fold", pytest.approx(heights[1].max(), rel=1e-2))
    assert raised.time in heights[0]
    session.set_value("far", ("strength",), 0)
    assert session.raised("far") is None


@pytest.mark.slow
def test_a_draft_is_no_step(session: Session) -> None:
    before = session.meshes("fold", 1.0)[0]
    session.set_value("crease", ("bumps",), 5, draft=True)
    assert not session.is_refined
    assert session.tools()[0].values["bumps"] == 5
    assert np.abs(session.meshes("fold", 1.0)[0].positions - before.positions).max() > 0.005
    assert session.text == TOOLS
    with pytest.raises(ConfigError, match=r"crease\.bumps: found 99"):
        session.set_value("crease", ("bumps",), 99, draft=True)
    assert session.tools()[0].values["bumps"] == 5
    with pytest.raises(ConfigError, match=r"tools\.yaml:8: tools\[0\]\.bumps: found 99"):
        session.set_value("crease", ("bumps",), 99)
    assert session.meshes("fold", 1.0)[0].source is before.source
    assert not session.undo()


@pytest.mark.slow
def test_a_draft_of_one_side_leaves_the_other_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(TOOLS.replace("crease", "crease.L").replace("far", "crease.R"))
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")
    session.set_value("crease.L", ("bumps",), 5, draft=True)
    assert set(session.attached_tools()) == {"crease.L", "across", "crease.R"}
    session.mirror("across", "z")
    session.set_value("across.L", ("bumps",), 3, draft=True)
    assert [session.attached_tools()[name].attached.tool.bumps for name in ("across.L", "across.R", "crease.R")] == [
        3,
        2,
        2,
    ]
    session.set_value("across.L", ("bumps",), 3)
    assert [session.attached_tools()[name].attached.tool.bumps for name in ("across.L", "across.R", "crease.R")] == [
        3,
        3,
        2,
    ]
    session.solo(["across.L"])
    assert set(session.attached_tools()) == {"across.L", "across.R"}
    session.solo(["crease.L"])
    assert set(session.attached_tools()) == {"crease.L"}


@pytest.mark.slow
def test_a_frame_that_is_looked_up_is_the_one_that_is_computed(session: Session) -> None:
    time = float(session.frame_times("fold")[20])
    (looked_up,), (computed,) = (session.meshes("fold", at) for at in (time, float(np.nextafter(time, 1.0))))
    assert np.abs(looked_up.positions - computed.positions).max() < 1e-9
    (flat,) = session.meshes("fold", time, wrinkled=False)
    assert np.abs(looked_up.positions - flat.positions).max() > 0.01


@pytest.mark.parametrize("size", [1.3, 1e-3, 1e4])
def test_a_place_is_written_to_a_thousandth_of_the_segment(tmp_path: Path, size: float) -> None:
    tools = TOOLS.partition("  - {name: across")[0].replace("0.4", str(0.4 * size)).replace("0.25", str(0.25 * size))
    (tmp_path / "tools.yaml").write_text(tools.replace("0.3", str(0.3 * size)))
    session = Session(
        limb(tmp_path / "limb.glb", rings=5, sides=6, root={"scale": [size] * 3}), tmp_path / "tools.yaml"
    )
    wanted = size * np.array([-0.39172839, 0.25, 1e-7])
    session.move_point("crease", 0, wanted)
    written = yaml.safe_load(session.text)["tools"][0]["origin"]
    assert np.abs(written - wanted).max() <= 0.001 * 0.8 * size
    # No digit is written that says less than a ten-thousandth of the segment.
    digit = 10.0 ** np.floor(np.log10(0.8 * size)) / 1000
    assert all(abs(x / digit - round(x / digit)) < 1e-6 for x in written)


def test_no_save_writes_over_what_the_session_reads(tmp_path: Path) -> None:
    asset = limb_asset(rings=8, sides=6)
    (tmp_path / "limb.bin").write_bytes(asset.data)
    gltf = {**asset.gltf, "buffers": [{"byteLength": len(asset.data), "uri": "limb.bin"}]}
    (tmp_path / "limb.gltf").write_text(json.dumps(gltf))
    limb(tmp_path / "walk.glb", rings=8, sides=6)
    tools = tmp_path / "tools.yaml"
    tools.write_text(TOOLS)
    session = Session(tmp_path / "limb.gltf", tools, ReadOptions(anims=[tmp_path / "walk.glb"]))
    session.set_value("crease", ("bumps",), 5)
    inputs = {name: (tmp_path / name).read_bytes() for name in ("limb.gltf", "limb.bin", "walk.glb")}
    for name in inputs:
        for plant in (Path.symlink_to, Path.hardlink_to):
            tools.unlink()
            plant(tools, tmp_path / name)
            with pytest.raises(BakeError, match="is an input too"):
                session.save(overwrite=True)
    tools.unlink()
    os.mkfifo(tools)
    with pytest.raises(BakeError, match="not a regular file"):
        session.save(overwrite=True)
    tools.unlink()
    tools.symlink_to("elsewhere.yaml")
    (tmp_path / "elsewhere.yaml").write_text(TOOLS)
    session.save()
    assert tools.is_symlink()
    assert "bumps: 5" in (tmp_path / "elsewhere.yaml").read_text()
    assert inputs == {name: (tmp_path / name).read_bytes() for name in inputs}


def test_a_tools_file_that_is_a_buffer_too_is_not_opened(tmp_path: Path) -> None:
    asset = limb_asset(rings=8, sides=6)
    (tmp_path / "limb.bin").write_bytes(asset.data)
    sizes = {"limb.bin": len(asset.data), "tools.yaml": len(TOOLS)}
    buffers = [{"byteLength": size, "uri": uri} for uri, size in sizes.items()]
    (tmp_path / "limb.gltf").write_text(json.dumps({**asset.gltf, "buffers": buffers}))
    (tmp_path / "tools.yaml").write_text(TOOLS)
    (tmp_path / "link.yaml").symlink_to("tools.yaml")
    for name in ("tools.yaml", "link.yaml"):
        with pytest.raises(BakeError, match=f"{name}: is an input too"):
            Session(tmp_path / "limb.gltf", tmp_path / name)


@pytest.mark.parametrize("name", ["limb.glb", "walk.glb"])
def test_no_bake_writes_over_what_the_session_reads(name: str, tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(TOOLS)
    for each in ("limb.glb", "walk.glb"):
        limb(tmp_path / each, rings=8, sides=6)
    session = Session(tmp_path / "limb.glb", tmp_path / "tools.yaml", ReadOptions(anims=[tmp_path / "walk.glb"]))
    before = (tmp_path / name).read_bytes()
    (tmp_path / "limb_wrinkled.glb").symlink_to(name)
    with pytest.raises(BakeError, match="is an input too"):
        baked_of(session, tmp_path)
    assert (tmp_path / name).read_bytes() == before


def test_what_is_not_valid_changes_nothing(session: Session) -> None:
    with pytest.raises(ConfigError, match="bumps: found 99"):
        session.set_value("crease", ("bumps",), 99)
    assert session.text == TOOLS
    session.move_point("crease", 0, [5.0, 5.0, 5.0])
    assert "from the mesh" in str(session.tools()[0].problem)
    assert len(session.meshes(None, 0.0)) == 1


def test_what_a_bake_would_refuse_or_leave_out_is_the_tools_problem(session: Session) -> None:
    session.set_value("crease", ("clips", "fould"), 1)
    session.set_value("far", ("strength",), 0)
    first, second, third = (tool.problem for tool in session.tools())
    assert "did you mean 'fold'" in str(first)
    assert second is None
    assert third == "far: is left out, as its strength is 0 in every clip"


@pytest.mark.slow
def test_a_tool_with_a_partner_names_its_side(session: Session) -> None:
    assert session.mirror("far", "x") == "far.R"
    assert [tool.partner for tool in session.tools()] == [None, None, "far.L"]
    session.undo()
    assert session.text == TOOLS


@pytest.mark.slow
@pytest.mark.long
def test_what_suggest_finds_is_accepted_one_by_one(session: Session, tmp_path: Path) -> None:
    offers = session.proposals()
    assert offers
    assert not session.notes, "what was left out is told where nothing was found"
    assert "joint joint_1, shortened by " in offers[0].why
    (first,) = session.accept(offers[0])
    (second,) = session.accept(offers[0])
    assert first != second
    session.delete("far")
    before = session.text
    assert session.accept(offers[0], offers[0]) == [f"{offers[0].name}_2", f"{offers[0].name}_3"]
    session.undo()
    assert session.text == before
    assert [tool.problem for tool in session.tools()] == [None] * len(session.tools())
    suggested = suggest(tmp_path / "limb.glb").tools[0].tool
    (own,) = (tool for tool in session.settings().tools if tool.name == first)
    assert replace(own, where="", max_height=suggested.max_height) == replace(suggested, where="")


@pytest.mark.slow
def test_a_proposal_is_tried_alone_where_it_is_tallest(session: Session) -> None:
    (offer, *_) = session.proposals()
    text = session.text
    tried = session.try_out(offer)
    assert tried is not None
    assert (session.text, tried.clip.name) == (text, "fold")
    (before,), (after,) = (tried.shown(tried.time, wrinkled=wrinkled) for wrinkled in (False, True))
    moved = np.sqrt(np.sum((after.positions - before.positions) ** 2, axis=1))
    assert moved.max() == pytest.approx(tried.height, rel=0.2)
    (name,) = session.accept(offer)
    taken = session.raised(name)
    assert taken is not None
    assert taken.time == tried.time


@pytest.mark.slow
@pytest.mark.long
def test_a_field_is_proposed_for_a_garment_tried_and_taken(tmp_path: Path) -> None:
    asset = sleeve(rings=24, sides=16)
    asset.gltf["materials"] = [{"name": "denim"}]
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    session = Session(asset.write(tmp_path / "limb.glb"), tmp_path / "tools.yaml")
    (offer,) = session.proposals()
    assert (offer.list_key, session.is_taken(offer)) == ("fields", False)
    tried = session.try_out(offer)
    assert tried is not None
    assert tried.height > 0.005
    (name,) = session.accept(offer)
    assert yaml.safe_load(session.text)["fields"] == [{**offer.values, "name": name}]
    assert session.is_taken(offer)
    assert [tool.problem for tool in session.tools()] == [None]


def test_a_place_that_has_a_tool_is_taken_for_what_runs_the_same_way(tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")
    offers = session.proposals()
    assert not any(map(session.is_taken, offers))
    session.accept(offers[0])
    assert session.is_taken(offers[0])
    session.undo()
    assert not session.is_taken(offers[0])
    ends = np.array([offers[0].values["origin"], offers[0].values["target"]])
    along, middle = ends[1] - ends[0], ends.mean(axis=0)
    turned = along[[2, 1, 0]] / 4.0
    session.add("tools", [(middle - turned).tolist(), (middle + turned).tolist()])
    assert session.tools()[0].problem is None
    assert not session.is_taken(offers[0])


@pytest.mark.slow
@pytest.mark.long
def test_places_are_found_in_the_pose_that_is_set(tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")
    clip = session.clips[0]
    in_motion = session.proposals()
    session.take_pose(FreePose().with_turn("joint_1", "y", -60.0))
    posed = session.proposals(posed=True)
    assert posed != in_motion
    assert all(clip.name not in each.why for each in posed)
    tried = session.try_out(posed[0])
    assert tried is not None
    assert tried.height > 0
    assert session.proposals() == in_motion


@pytest.mark.slow
def test_a_material_takes_the_place_of_a_tools_own_keys_in_one_step(session: Session) -> None:
    session.set_value("across", ("max_height",), "5%")
    before = session.text
    tried = session.try_material("across", "leather")
    assert tried is not None
    assert session.set_material("across", "leather") == ["bumps", "max_height"]
    across = session.tools()[1]
    assert (across.values["bumps"], across.keys["bumps"].source) == (tried.attached.attached.tool.bumps, "material")
    assert across.own == {"name", "origin", "target", "width", "material"}
    assert session.undo()
    assert session.text == before


@pytest.mark.slow
def test_warnings_are_beside_the_tool_that_they_are_about(session: Session) -> None:
    session.set_value("crease", ("strength",), 2)
    session.save()
    found = session.warnings()
    assert any("strength 2 does not keep the length" in line for line in found["crease"])
    checked = check(session.asset, session.path)
    assert sorted(line for lines in found.values() for line in lines) == sorted(checked.warnings)


@pytest.mark.slow
@pytest.mark.long
def test_warnings_are_beside_the_muscle_or_flesh_that_they_are_about(tmp_path: Path) -> None:
    """A muscle on one bone, one that bulges through the folded limb, one that fits, and flesh that hardly moves."""
    asset = limb(tmp_path / "limb.glb", rings=20, sides=12, angle=125.0)
    session = Session(asset, tmp_path / "tools.yaml")
    still = session.add("muscles", [[-0.9, RADIUS, 0.0], [-0.1, RADIUS, 0.0]])
    folded = session.add("muscles", [[-0.8, RADIUS, 0.0], [0.15, RADIUS, 0.0]])
    session.set_value(folded, ("thickness",), "30%")
    behind = session.add("muscles", [[-0.8, -RADIUS, 0.0], [0.15, -RADIUS, 0.0]])
    region = session.add("flesh", [[-0.6, -RADIUS, 0.0], [-0.6, -RADIUS, 0.15]])
    session.save()
    found = session.warnings()
    for name, said in ((still, "so no joint shortens it"), (folded, "passes through"), (region, "hardly moves")):
        assert any(said in line for line in found[name]), name
    assert not found.get(behind)
    lines = [line for lines in found.values() for line in lines]
    assert sorted(lines) == sorted(check(session.asset, session.path).warnings)


@pytest.mark.parametrize(("gap", "share"), [(0.0, 1.0), (0.1, RADIUS / (RADIUS + 0.1))])
def test_an_end_below_clothes_lies_in_the_body(gap: float, share: float, tmp_path: Path) -> None:
    (tmp_path / "limb.glb").write_bytes(sleeved_limb(gap=gap, rings=20, sides=24).glb())
    session = Session(tmp_path / "limb.glb", tmp_path / "tools.yaml")
    session.add("muscles", [[-0.8, RADIUS + gap, 0.0], [0.3, RADIUS + gap, 0.0]], "sleeve")
    (written,) = yaml.safe_load(session.text)["muscles"]
    for key in ("origin", "insertion"):
        assert written[key]["offset"][1] == pytest.approx(0.45 * share * (RADIUS + gap), rel=0.02)


@pytest.mark.slow
def test_an_asset_that_is_exported_again_gets_the_same_tools(session: Session, tmp_path: Path) -> None:
    session.set_value("crease", ("bumps",), 5)
    before = session.meshes("fold", 0.5)[0]
    limb(tmp_path / "limb.glb", rings=16, sides=12, joints=3)
    (tmp_path / "tools.yaml").write_text(TOOLS.replace("rest_length: 120%", "rest_length: 130%"))
    assert not session.refresh()
    assert session.refresh()
    assert not session.refresh()
    assert "exported again" in "".join(session.notes)
    after = session.meshes("fold", 0.5)[0]
    assert len(after.positions) != len(before.positions)
    assert [tool.problem for tool in session.tools()] == [None] * 3
    assert [tool.bumps for tool in session.settings().tools] == [5, 2, 2]
    assert "130%" in session.text
    # One that is not whole, and one from which the tools have gone.
    (tmp_path / "limb.glb").write_bytes(b"glTF")
    session.refresh()
    assert session.refresh()
    assert session.meshes("fold", 0.5)[0].source is after.source
    limb(tmp_path / "limb.glb", rings=16, sides=12, root={"translation": [9, 0, 0]})
    session.refresh()
    assert session.refresh()
    assert all("from the mesh" in str(tool.problem) for tool in session.tools())


MUSCLES = (
    TOOLS
    + """\
muscles:
  - name: biceps
    origin: {joint: joint_0, offset: [0.15, 0.1, 0]}
    insertion: {joint: joint_1, offset: [0.15, 0.1, 0]}
"""
)


@pytest.mark.slow
def test_muscles_are_shown_as_they_are_baked(tmp_path: Path) -> None:
    """Wrinkles lie on the skin that muscles move."""
    (tmp_path / "tools.yaml").write_text(MUSCLES)
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12), tmp_path / "tools.yaml")
    report = wrinklecli.bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb")
    document = read_document(tmp_path / "out.glb")
    (primitive,), (clip,) = read_scene(document), read_clips(document)
    for time in (0.0, 1.0):
        (shown,) = session.meshes("fold", time)
        baked = primitive.positions_at(clip, time)
        for some, others in ((shown.positions, baked), (baked, shown.positions)):
            assert cKDTree(others).query(some)[0].max() < report.data["meshes"][0]["max_error"]


@pytest.mark.slow
def test_two_places_make_a_muscle(session: Session, tmp_path: Path) -> None:
    (shown,) = session.meshes("fold", 1.0)
    count = len(shown.source.ground.surface.positions)
    before = shown.positions[:count]
    name = session.add("muscles", [[-0.8, RADIUS, 0.0], [0.15, RADIUS, 0.0]], "limb")
    assert name == "muscle_1"
    assert np.abs(session.meshes("fold", 1.0)[0].positions[:count] - before).max() > 0.01
    (entry,) = yaml.safe_load(session.text)["muscles"]
    assert [entry[key]["joint"] for key in ("origin", "insertion")] == ["joint_0", "joint_1"]
    assert session.text.startswith(TOOLS)
    session.save()
    wrinklecli.bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb")
    assert session.add("muscles", [[-0.8, -RADIUS, 0.0], [0.15, -RADIUS, 0.0]]) == "muscle_2"
    session.undo()
    session.undo()
    assert session.text == TOOLS


@pytest.mark.quick(1)
@pytest.mark.parametrize("list_key", [key for key, kind in NEW_KINDS.items() if len(kind.asks) == 2])
def test_what_does_not_fit_makes_no_step(session: Session, list_key: str) -> None:
    with pytest.raises(ConfigError):
        session.add(list_key, [[-0.5, 9.0, 0.0], [0.5, 9.0, 0.0]])
    assert not session.changed


@pytest.mark.parametrize("list_key", NEW_KINDS)
def test_nothing_is_made_on_a_mesh_that_nothing_moves(tmp_path: Path, list_key: str) -> None:
    asset = limb_asset(rings=7, sides=6)
    for node in asset.gltf["nodes"]:
        node.pop("skin", None)
    session = Session(asset.write(tmp_path / "limb.glb"), tmp_path / "tools.yaml")
    with pytest.raises(ConfigError, match="neither joints nor morph targets move this mesh"):
        session.add(list_key, [[-0.5, 0.25, 0.0], [0.5, 0.25, 0.0]])


def test_a_muscle_is_the_first_entry_of_a_new_file(tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb", rings=9, sides=8), tmp_path / "new.yaml")
    session.add("muscles", [[-0.8, RADIUS, 0.0], [0.15, RADIUS, 0.0]])
    session.save()
    wrinklecli.bake(tmp_path / "limb.glb", tmp_path / "new.yaml", tmp_path / "out.glb")


@pytest.mark.slow
@pytest.mark.long
def test_two_places_make_flesh(tmp_path: Path) -> None:
    """The second is how far it reaches. It plays as it is baked."""
    (tmp_path / "body.glb").write_bytes(body(keys=20, normals=False).glb())
    session = Session(tmp_path / "body.glb", tmp_path / "tools.yaml")
    before = session.meshes("jump", 1.08)[0].positions
    assert session.add("flesh", [[0.0, -0.05, 0.18], [0.0, 0.08, 0.18]]) == "flesh_1"
    assert yaml.safe_load(session.text)["flesh"] == [{"name": "flesh_1", "at": [0.0, -0.05, 0.18], "radius": 0.13}]
    shown = session.meshes("jump", 1.08)[0].positions
    assert np.abs(shown - before).max() > 0.005
    session.save()
    wrinklecli.bake(tmp_path / "body.glb", tmp_path / "tools.yaml", tmp_path / "out.glb")
    document = read_document(tmp_path / "out.glb")
    (primitive,), (clip,) = read_scene(document), read_clips(document)
    baked = primitive.positions_at(clip, 1.08)
    assert cKDTree(baked).query(shown)[0].max() < 5e-4
    with pytest.raises(ConfigError, match="larger than the body allows"):
        session.add("flesh", [[0.0, -0.05, 0.18], [0.0, 9.0, 0.18]])


@pytest.mark.slow
def test_muscles_are_edited_as_tools_are(session: Session) -> None:
    """One list, one mechanism: values with their sources, drafts, names, copies, undo."""
    name = session.add("muscles", [[-0.8, RADIUS, 0.0], [0.15, RADIUS, 0.0]], "limb")
    muscle = next(each for each in session.tools() if each.name == name)
    assert (muscle.list_key, muscle.keys["tendon"].value, muscle.keys["tendon"].source) == (
        "muscles",
        "40%",
        "built-in",
    )
    assert muscle.length == pytest.approx(0.95, rel=0.1)
    session.delete("crease")
    session.delete("across")
    session.delete("far")
    before = shape_at(session)
    session.set_value(name, ("thickness",), 0.2, draft=True)
    drafted = shape_at(session)
    assert np.abs(drafted - before).max() > 1e-3
    session.set_value(name, ("thickness",), 0.2)
    assert yaml.safe_load(session.text)["muscles"][0]["thickness"] == 0.2
    np.testing.assert_array_equal(shape_at(session), drafted)
    assert session.inherited(next(each for each in session.tools() if each.name == name))["thickness"].value == "auto"
    session.rename(name, "biceps")
    assert session.copy("biceps") == "biceps_1"
    assert session.mirror("biceps_1", "x") == "biceps_1.R"
    session.undo()
    session.delete("biceps_1")
    raised = session.raised("biceps")
    assert raised is not None
    assert (raised.clip.name, raised.time) == ("fold", pytest.approx(1.0, abs=0.1))
    session.delete("biceps")
    assert "muscles" not in yaml.safe_load(session.text)
    for _ in range(3):
        assert session.undo()
    assert [each["name"] for each in yaml.safe_load(session.text)["muscles"]] == ["biceps"]


def shape_at(session: Session) -> Array:
    """(vertices, 3) of the first mesh in the middle of its first clip."""
    clip = session.clips[0].name
    times = session.frame_times(clip)
    return session.meshes(clip, float(times[len(times) // 2]), wait=False)[0].positions


@pytest.mark.slow
def test_muscles_of_several_hands_are_merged(session: Session) -> None:
    session.add("muscles", [[-0.8, RADIUS, 0.0], [0.15, RADIUS, 0.0]], "limb")
    session.save()
    path = Path(session.path)
    path.write_text(path.read_text().replace("name: muscle_1", "name: muscle_1\n    tendon: 30%"))
    session.set_value(session.tools()[0].name, ("enabled",), False)
    session.save()
    assert yaml.safe_load(path.read_text())["muscles"][0]["tendon"] == "30%"
    path.write_text(path.read_text().replace("30%", "31%"))
    session.set_value("muscle_1", ("tendon",), "32%")
    with pytest.raises(ConfigError, match="muscle_1: was changed here, and otherwise in the file on disk"):
        session.save()


@pytest.mark.slow
def test_frequency_and_damping_are_felt_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of the springs solves nothing again, leaves what lies on the skin, and shows what a bake plays."""
    (tmp_path / "body.glb").write_bytes(body(keys=20, normals=False).glb())
    session = Session(tmp_path / "body.glb", tmp_path / "tools.yaml")
    name = session.add("flesh", [[0.0, -0.05, 0.18], [0.0, 0.08, 0.18]])
    before, (mesh,) = shape_at(session), session.meshes("jump", 0.0)
    monkeypatch.setattr("wrinklecli.effects.flesh.attach.swings_of", lambda *_: pytest.fail("was solved again"))
    for frequency in (2.0, 2.5, 3.0):
        session.set_value(name, ("frequency",), frequency, draft=True)
    drafted = shape_at(session)
    assert np.abs(drafted - before).max() > 1e-3
    session.set_value(name, ("frequency",), 3.0)
    session.set_value(name, ("damping",), 0.6)
    (again,) = session.meshes("jump", 0.0)
    assert again.source.ground is mesh.source.ground
    shown = shape_at(session)
    monkeypatch.undo()
    (tmp_path / "other.yaml").write_text(session.text)
    fresh = Session(tmp_path / "body.glb", tmp_path / "other.yaml")
    np.testing.assert_allclose(shape_at(fresh), shown, atol=1e-12)


@pytest.mark.slow
def test_a_field_is_shown_and_its_strength_changes_at_once(tmp_path: Path) -> None:
    """Other strengths have the same shapes; another wavelength is carried by the triangles that there are."""
    asset, tools = sleeve_and_field(tmp_path)
    session = Session(asset, tools)
    plain = session.meshes("fold", 0.0)[0].positions
    (before,) = session.meshes("fold", 1.0)
    (tool,) = session.tools()
    assert (tool.list_key, tool.problem) == ("fields", None)
    assert tool.length == session.attached_tools()["folds"].attached.span > 0
    part = session.attached_tools()["folds"].part
    session.set_value("folds", ("strength",), 0.5)
    (half,) = session.meshes("fold", 1.0, wait=False)
    assert session.attached_tools()["folds"].part.vertices.tolist() == part.vertices.tolist()
    session.set_value("folds", ("strength",), 0)
    (none,) = session.meshes("fold", 1.0, wait=True)
    assert half.positions == pytest.approx((before.positions + none.positions) / 2.0, abs=1e-9)
    assert np.abs(before.positions - none.positions).max() > 0.01
    session.set_value("folds", ("strength",), 1)
    session.set_value("folds", ("wavelength",), 0.1)
    (other,) = session.meshes("fold", 1.0, wait=False)
    assert np.abs(other.positions - before.positions).max() > 0.005
    assert session.meshes("fold", 0.0)[0].positions == pytest.approx(plain, abs=1e-9)
    assert len(session.curve("folds", "fold", 1.0)) == 0
    times, heights = session.heights("folds", "fold")
    assert len(times) == len(heights)
    assert heights.max() > 0


def test_a_click_makes_a_field_that_is_edited_as_tools_are(tmp_path: Path) -> None:
    asset, _ = sleeve_and_field(tmp_path)
    text = "version: 1\nrefinement: {max_levels: 0}  # quick\n"
    (tmp_path / "tools.yaml").write_text(text + "tools: []\n")
    session = Session(asset, tmp_path / "tools.yaml")
    plain = session.meshes("fold", 1.0)[0].positions
    name = session.add("fields", [[0.0, 0.25, 0.0]], "limb")
    assert session.text == text + "fields:\n  - name: field_1\n"
    assert np.abs(session.meshes("fold", 1.0)[0].positions - plain).max() > 0.01
    session.enable(name, enabled=False)
    assert np.array_equal(session.meshes("fold", 1.0)[0].positions, plain)
    session.delete(name)
    assert not session.tools()
    session.undo()
    session.undo()
    assert [(tool.name, tool.problem) for tool in session.tools()] == [("field_1", None)]
    session.undo()
    assert session.text == text + "tools: []\n"


def test_a_field_that_does_not_fit_has_the_line_of_a_bake(tmp_path: Path) -> None:
    asset, tools = sleeve_and_field(tmp_path, joints=["joint_7"])
    session = Session(asset, tools)
    session.meshes("fold", 1.0)
    (tool,) = session.tools()
    assert "no joint 'joint_7' bends its mesh" in tool.problem
