"""Slides beside a joint that bends: the targets against slides that are solved anew in the bent pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Json
from kit.bakes import bake_once, place
from kit.limb import RADIUS, limb_asset
from kit.places import ROOT
from kit.player import Gltf
from kit.touch import plate, touch
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.character.surface import influence_count
from wrinklecli.drive.touch import EVERY, TouchDrive
from wrinklecli.effects.touch.attach import _ASLANT, _turn, attach_touch
from wrinklecli.effects.touch.skin import Place, hold_of, slides_on
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import Floats, inverses, unit
from wrinklecli.surface.ground import read_ground
from wrinklecli.surface.refine import refine
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import RestFrame

BACK: Json = touch(at=[0.042, 0.0178, 0.0], towards=[0.0, 0.0178, 0.0], keys={}, wrinkles={"directions": 1})


def errors(asset: Path, spot: Json, clip: str, time: float) -> tuple[float, float]:
    """The distance of slides of any direction from ones that are solved in a pose, at 99 % of the skin, over the slide.

    Returns:
        By the shapes of the rest pose alone, and with their changes in a bend.
    """
    document = read_document(asset)
    clips, (node, *_) = read_clips(document), deforming_nodes(document)
    settings = read_values({"version": 1, "touches": [spot]}, name="tools", known={})
    ground = read_ground(document, node, [], settings, clips)
    dragged = attach_touch(settings.effects[0], ground, settings)
    fine = refine(
        ground.surface,
        ground.rest,
        dragged.regions,
        ground.rig,
        settings=replace(settings.refinement, max_levels=1),
        contacts=ground.contacts.held,
        influences=influence_count(document, ground.rig),
        poses=replace(ground.poses, clips=()),
        tolerance=np.inf,
    )
    posed = read_ground(document, node, [], replace(settings, rest=RestFrame(clip=clip, time=time)), clips)
    attached = dragged.places[0]
    slides, place = slides_on(fine, fine.rest_positions, attached.place, attached.hold), attached.place
    # The place in the pose.
    triangle, corners, _ = ground.rest.closest_point(place.at)
    vertices = ground.rest.triangles[triangle]
    before, after = (np.einsum("k,kab->ab", corners, each.rest.blended[vertices, :, :3]) for each in (ground, posed))
    normal = unit(corners @ posed.rest.normals_at(vertices))
    forward = after @ np.linalg.solve(before, place.axes[0])
    forward = unit(forward - (forward @ normal) * normal)
    axes = np.stack([forward, np.cross(normal, forward), normal])
    there = Place(corners @ posed.rest.positions[vertices], axes, place.pad, place.reach)
    positions, _ = fine.posed_at(posed.rest, np.arange(len(fine.positions)))
    anew = slides_on(fine, positions, there, hold_of(posed, there, None))
    blended = fine.subdivision.interpolate(posed.rest.blended.reshape(-1, 12)).reshape(-1, 3, 4)
    carried = blended[:, :, :3] @ inverses(fine.blended)
    found = []
    (bend,) = dragged.drive.bends_in(
        ground.rig.own, next(each for each in clips if each.name == clip), np.array([time])
    )
    assert attached.bending is not None
    changes = attached.bending.changes(fine, slides)
    for shown in (slides, slides + max(bend, 0.0) * changes[0] + max(-bend, 0.0) * changes[1]):
        angles = np.arange(8) * np.pi / 4
        off = np.einsum("vab,dvb->dva", carried, shown) - anew
        every = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        far = [np.linalg.norm(np.tensordot(way, off, axes=1), axis=1) for way in every]
        moving = [np.linalg.norm(np.tensordot(way, anew, axes=1), axis=1) > 0.01 for way in every]
        found.append(max(float(np.percentile(each[here], 99)) for each, here in zip(far, moving, strict=True)))
    return found[0], found[1]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("clip", "time"), [("flex", 0.35), ("extend", 0.35)])
def test_slides_beside_a_bent_wrist_are_those_solved_there(clip: str, time: float) -> None:
    plain, changed = errors(ROOT / "samples" / "wrist.glb", BACK, clip, time)
    assert plain > 0.03, "the shapes of the rest pose are not enough"
    assert changed < 0.02


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("clip", ["flex", "extend"])
def test_slides_beside_a_fist_and_a_wrist_bent_back_are_those(clip: str) -> None:
    """At 70°, where fingers and thumb turn, too, and bent back by 60°."""
    plain, changed = errors(ROOT / "samples" / "wrist.glb", BACK, clip, 1.0)
    assert plain > 0.06
    assert changed < 0.02


@pytest.fixture(scope="module")
def limb() -> tuple[Path, dict[str, TouchDrive]]:
    """A limb with touches inside and outside of its bend, and their drives."""
    keys = {"fold": [[0.0, 0.03, 0.0], [2.0, 0.03, 0.0]]}
    spots = [
        {"name": name, "at": [0.45, y, 0.0], "towards": [0.0, y, 0.0], "pad": 0.1, "reach": 0.2, "keys": keys}
        for name, y in (("inside", RADIUS), ("outside", -RADIUS))
    ]
    file = bake_once(place(limb_asset(rings=24, sides=16)), top={"touches": spots, "refinement": {"max_levels": 0}})
    nodes = {each["name"]: number for number, each in enumerate(file.json["nodes"])}
    drives = [each.on(nodes, []) for each in read_bodies(read_document(file.path))[0].drives]
    return file.path, {each.name: each for each in drives if isinstance(each, TouchDrive)}


@pytest.mark.slow
def test_the_bend_is_the_sine_of_the_joints_angle(limb: tuple[Path, dict[str, TouchDrive]]) -> None:
    path, drives = limb
    document = read_document(path)
    rig, (clip, *_) = read_rig(document, 0), read_clips(document)
    times = np.array([0.0, 0.3, 0.6, 0.9])
    bends = {name: drive.bends_in(rig, clip, times) for name, drive in drives.items()}
    # The clip turns the joint by 100° in a second, as a slerp.
    wanted = np.sin(np.radians(100.0) * times)
    assert np.abs(bends["outside"]) == pytest.approx(wanted, abs=0.02)
    assert bends["outside"] == pytest.approx(-bends["inside"], abs=0.02)
    assert abs(bends["inside"][0]) < 1e-6


@pytest.mark.slow
def test_the_bend_is_counted_from_the_rest_pose_of_a_clip() -> None:
    """Laid where the joint is bent by 30°, the same place of the skin has the same bends, less those 30°."""
    turn = np.radians(30.0)
    cosine, sine = float(np.cos(turn)), float(np.sin(turn))
    at = [0.45 * cosine - RADIUS * sine, 0.45 * sine + RADIUS * cosine, 0.0]
    spot = {"name": "laid", "at": at, "towards": [0.0, 0.0, 0.0], "pad": 0.1, "reach": 0.2, "wrinkles": "none"}
    top = {"touches": [spot], "rest": {"clip": "fold", "time": 0.3}, "refinement": {"max_levels": 0}}
    document = read_document(bake_once(place(limb_asset(rings=24, sides=16)), top=top).path)
    nodes = {each.get("name"): number for number, each in enumerate(document.items("nodes"))}
    (stored,) = read_bodies(document)[0].drives
    drive = stored.on(nodes, [])
    assert isinstance(drive, TouchDrive)
    times = np.array([0.0, 0.3, 0.6, 0.9])
    bends = drive.bends_in(read_rig(document, 0), read_clips(document)[0], times)
    assert bends == pytest.approx(np.sin(np.radians(100.0 * times) - turn) * np.sign(bends[-1]), abs=0.02)
    assert abs(bends[1]) < 1e-6
    assert len(drive.targets) == len(EVERY) + TouchDrive.bent


@pytest.mark.slow
def test_weights_of_changes_are_those_of_slides_times_the_bend(limb: tuple[Path, dict[str, TouchDrive]]) -> None:
    _, drives = limb
    drive = drives["inside"]
    contacts = np.array([[0.5, -0.3, 0.2]]) * [drive.grip, drive.grip, drive.deepest]
    for bend in (0.0, 0.6, -0.4):
        (weights,) = drive.weights_of_contacts(contacts, np.array([bend]))
        ways, towards, away = weights[:4], weights[-8:-4], weights[-4:]
        assert towards == pytest.approx(max(bend, 0.0) * ways)
        assert away == pytest.approx(max(-bend, 0.0) * ways)
    assert len(drive.targets) == len(weights)


@pytest.mark.slow
def test_skin_that_no_joint_bends_has_no_more_targets() -> None:
    file = bake_once(place(plate()), top={"touches": [touch()], "refinement": {"max_levels": 0}})
    (stored,) = read_bodies(read_document(file.path))[0].drives
    assert "limb" not in stored.data
    assert len(stored.targets) == len(EVERY) + 8


def test_a_slide_in_a_bent_pose_is_as_long_as_asked(limb: tuple[Path, dict[str, TouchDrive]]) -> None:
    """The changes leave the skin under the tip where it is: it sticks to the tip."""
    path, drives = limb
    file = Gltf(path)
    names = file.mesh("limb")["extras"]["targetNames"]
    deltas: Floats = file.deltas("limb")
    for name, y in (("inside", RADIUS), ("outside", -RADIUS)):
        drive = drives[name]
        near = np.linalg.norm(file.attribute("limb", "POSITION") - [0.45, y, 0.0], axis=1) < 0.11
        changes = deltas[[names.index(each) for each in drive.targets[-8:]]][:, near]
        assert np.abs(changes.mean(axis=1)).max() < 0.15 * drive.grip
        assert np.abs(deltas[[names.index(each) for each in drive.targets[-8:]]]).max() > 0.02 * drive.grip


@pytest.mark.parametrize("degrees", [-44.0, -10.0, 0.0, 20.0, 44.0])
def test_slides_turn_to_the_nearest_main_curvature(degrees: float) -> None:
    """A cylinder whose axis leans by an angle, as its quadric has it; one that hardly leans counts as straight."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    for curvature in (-40.0, 40.0):
        bend = curvature * np.array([c * c, 2.0 * c * s, s * s])
        assert _turn(bend, 0.02) == pytest.approx(np.radians(degrees), abs=1e-4)
        assert _turn(np.array([bend[2], -bend[1], bend[0]]), 0.02) == pytest.approx(np.radians(degrees), abs=1e-4)
    for share, turns in ((0.99, False), (1.01, True)):
        aslant = np.array([1.0, share * 2.0 * _ASLANT / 0.02, 0.0])
        assert bool(_turn(aslant, 0.02)) == turns
