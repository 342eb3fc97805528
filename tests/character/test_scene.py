"""Every primitive of a scene, posed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Asset
from kit.clients import pose_with_normals
from kit.limb import limb_asset
from kit.prepared import as_document
from kit.samples import Editor, edited, sample, shared_mesh, two_meshes, two_parts
from wrinklecli.character.clip import read_clips
from wrinklecli.character.scene import ScenePrimitive, drawn_with, read_scene, scene_nodes
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import face_normals


@pytest.mark.parametrize(
    ("asset", "clip"),
    [
        (lambda: sample("wrist"), "flex"),
        (lambda: sample("head"), "raise_brows"),
        (lambda: sample("trousers"), "squat"),
        (lambda: edited("wrist", two_parts), "extend"),
        (lambda: edited("wrist", shared_mesh), "flex"),
        (lambda: edited("wrist", two_meshes), "flex"),
    ],
)
def test_parts_are_posed_as_three_poses_them(asset: Callable[[], Path], clip: str) -> None:
    path = asset()
    document = read_document(path)
    found = next(each for each in read_clips(document) if each.name == clip)
    times = np.linspace(found.start, found.end, 5)
    by_node: dict[int, list[ScenePrimitive]] = {}
    for part in read_scene(document):
        by_node.setdefault(part.rig.node, []).append(part)
    assert by_node
    for node, parts in by_node.items():
        posed = [part.posed(found, times) for part in parts]
        positions, normals = pose_with_normals(path, node=node, clip=found.index, times=times.tolist())
        ours = np.concatenate([each.positions for each in posed], axis=1)
        assert np.abs(ours - positions).max() < 4e-6 * np.abs(positions).max()
        turned = np.concatenate([each.normals for each in posed if each.normals is not None], axis=1)
        # three.js turns normals by the joints' matrices themselves, which rigid joints make the same but where blended.
        assert np.median(np.sum(turned * normals, axis=2)) > 0.9999
        assert not any(each.hidden.any() or each.mirrored.any() for each in posed)


def test_only_the_default_scene_is_shown() -> None:
    def aside(editor: Editor) -> None:
        gltf = editor.json
        gltf["scenes"] = [{"nodes": []}, {"nodes": [0]}]
        gltf["scene"] = 1

    document = read_document(edited("wrist", aside))
    children = document.items("nodes")[0].get("children", [])
    assert scene_nodes(document)[0] == 0
    assert set(children) <= set(scene_nodes(document))
    del document.gltf["scenes"]
    assert scene_nodes(document) == list(range(len(document.items("nodes"))))


def test_what_is_drawn_with_a_node() -> None:
    """Two bodies of two and three levels with a hat on the first ones, in one scene, and a hidden one beside them."""
    nodes = [
        {"extensions": {"MSFT_lod": {"ids": [1]}}, "children": [2]},
        {"children": [3]},
        {},
        {},
        {"extensions": {"MSFT_lod": {"ids": [5, 6]}}},
        {},
        {},
        {"extensions": {"KHR_node_visibility": {"visible": False}}, "children": [8, 9]},
        {},
        {},
        {},
        {"children": [12]},
        {},
    ]
    asset = Asset()
    asset.gltf |= {"nodes": nodes, "scenes": [{"nodes": [0, 1, 4, 7]}, {"nodes": [4, 10]}]}
    document = as_document(asset)
    assert scene_nodes(document) == [0, 2, 4]
    assert drawn_with(document, 2) == [0, 2, 4]
    assert drawn_with(document, 3) == [1, 3, 5], "the second level of each"
    assert drawn_with(document, 6) == [1, 3, 6, 10], "the last level of each, in both scenes"
    assert drawn_with(document, 4) == [0, 2, 4, 10], "in both scenes that hold it"
    assert drawn_with(document, 8) == [0, 2, 4, 7, 8, 9], "as if it were not hidden"
    assert drawn_with(document, 12) == [11, 12], "below the same root, in no scene"
    del document.gltf["scenes"]
    assert scene_nodes(document) == [0, 2, 4, 10, 11, 12]


def test_a_node_scaled_to_nothing_is_hidden_and_one_mirrored_winds_the_other_way() -> None:
    document = read_document(sample("wrist"))
    node = next(each for each in document.items("nodes") if "mesh" in each)
    node.pop("skin")
    for scale, hidden, mirrored in (((0, 0, 0), True, False), ((-1, 1, 1), False, True), ((1, 1, 1), False, False)):
        node["scale"] = list(scale)
        (part,) = read_scene(document)
        posed = part.posed(None, np.zeros(1))
        assert (posed.hidden[0], posed.mirrored[0]) == (hidden, mirrored)
        corners = posed.corners()
        assert len(corners) == (0 if hidden else len(part.triangles))
        assert posed.normals is not None
        a, b, c = corners.transpose(1, 0, 2)
        facing = np.sum(np.cross(b - a, c - a) * posed.normals[0][posed.wound()[:, 0]], axis=1)
        assert hidden or (facing > 0).mean() > 0.99


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, -2, -1], [-1, -1, -1]])
def test_a_skin_that_joints_mirror_winds_the_other_way(scale: list[float]) -> None:
    (part,) = read_scene(as_document(limb_asset(rings=9, sides=8, root={"scale": scale})))
    posed = part.posed(None, np.zeros(1))
    assert posed.mirrored[0] == (np.prod(scale) < 0)
    assert posed.normals is not None
    outward = face_normals(posed.positions[0], posed.wound())
    assert (np.sum(outward[:, None] * posed.normals[0, posed.wound()], axis=2) > 0).all()


@pytest.mark.slow
def test_some_vertices_are_posed_as_with_the_others() -> None:
    document = read_document(sample("trousers"))
    (part,) = read_scene(document)
    (clip, *_) = read_clips(document)
    random, times = np.random.default_rng(3), np.linspace(clip.start, clip.end, 3)
    offsets = random.normal(size=(3, len(part.vertices.positions), 3))
    chosen = np.flatnonzero(random.random(offsets.shape[1]) < 0.5)
    whole, some = (
        part.posed(clip, times, offsets=offsets),
        part.only(chosen).posed(clip, times, offsets=offsets[:, chosen]),
    )
    assert whole.normals is not None
    assert some.normals is not None
    assert some.positions == pytest.approx(whole.positions[:, chosen], abs=1e-12)
    assert some.normals == pytest.approx(whole.normals[:, chosen], abs=1e-12)
    kept = np.isin(part.triangles, chosen).all(axis=1)
    assert 0 < kept.sum() < len(kept)
    assert np.array_equal(chosen[some.triangles], part.triangles[kept])
    assert part.positions_at(clip, times[1]) == pytest.approx(part.posed(clip, times[1:2]).positions[0], abs=1e-12)
    # Weights in place of the clip's, and offsets, act before skinning.
    still = part.posed(clip, times, offsets=np.zeros_like(offsets), weights=np.zeros((3, len(part.rig.morph_names))))
    assert still.positions == pytest.approx(part.posed(clip, times).positions, abs=1e-12)


def test_a_scene_that_names_no_node_is_said() -> None:
    gltf = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [99999]}]}
    with pytest.raises(AssetError, match=r"#/scenes/0/nodes: refers to nodes\[99999\], but there are 0"):
        as_document(Asset(gltf))
