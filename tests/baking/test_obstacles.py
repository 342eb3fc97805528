"""Other meshes beside a fold whose contact is resolved: wrinkles stay on their side, unless these are ignored."""

from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.limb import nose, sleeved_limb, tool, write_tools
from kit.player import Gltf
from wrinklecli.baking.report import Report
from wrinklecli.baking.track import track
from wrinklecli.errors import BakeError
from wrinklecli.numeric.intersections import Crossings
from wrinklecli.review.crossings import crossings


def baked(folder: Path, *, joined: bool = False, **contact: object) -> tuple[int, int]:
    """How often a limb crosses its sleeve, of a mesh of its own or joined with the limb's, before and after a bake."""
    return reported(folder, joined=joined, angle=32.0, **contact)[0]


def reported(folder: Path, *, joined: bool, angle: float, **contact: object) -> tuple[tuple[int, int], Report]:
    """The same, and what the bake said."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    asset = sleeved_limb(gap=0.05, rings=10, sides=6, angle=angle)
    if joined:
        asset.gltf["meshes"][0]["primitives"] += asset.gltf["meshes"][1]["primitives"]
        asset.gltf["scenes"][0]["nodes"].pop()
    entry = tool(node="limb", bumps=2, max_height="20%", contact=contact)
    tools = write_tools(folder / "tools.yaml", entry, refinement={"max_levels": 0}, sampling={"fps": 15})
    report = wrinklecli.bake(asset.write(folder / "limb.glb"), tools, folder / "out.glb")
    return counts(folder / "out.glb"), report


@pytest.mark.slow
@pytest.mark.long
def test_wrinkles_stay_beneath_a_sleeve(tmp_path: Path) -> None:
    crossings, report = reported(tmp_path, joined=False, angle=32.0)
    assert crossings == (0, 0)
    assert not any("goes through itself" in line for line in report.warnings)


@pytest.mark.slow
@pytest.mark.long
def test_a_sleeve_that_goes_through_itself_is_said(tmp_path: Path) -> None:
    (before, after), report = reported(tmp_path, joined=False, angle=75.0)
    assert after <= before > 0
    assert any("'sleeve' goes through itself there: contact leaves that" in line for line in report.warnings)


@pytest.mark.slow
@pytest.mark.long
def test_wrinkles_stay_beneath_a_sleeve_of_the_same_mesh(tmp_path: Path) -> None:
    assert baked(tmp_path, joined=True) == (0, 0)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("node", "joined"), [("sleeve", False), ("limb", True)])
def test_a_mesh_that_is_ignored_is_gone_through(node: str, joined: bool, tmp_path: Path) -> None:
    before, after = baked(tmp_path, joined=joined, ignore=[node])
    assert before == 0
    assert after > 10


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    "rest_length", ["100%", {"keys": {"sneer": [[0.0, "100%"], [1.0, "112%"], [2.0, "100%"]]}}], ids=["morph", "keyed"]
)
def test_a_nose_wrinkles_beneath_glasses_though_no_joint_bends_it(rest_length: object, tmp_path: Path) -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    asset, crossings = nose().write(tmp_path / "nose.glb"), {}
    bridge = tool(name="bridge", node="skin", origin=[-0.5, 0, 0], target=[0.5, 0, 0], width=0.8, bumps=4)
    for contact in ("off", "resolve"):
        entry = bridge | {"contact": contact, "rest_length": rest_length, "variation": 0}
        tools = write_tools(tmp_path / "tools.yaml", entry, refinement={"max_levels": 1})
        report = wrinklecli.bake(asset, tools, tmp_path / f"{contact}.glb")
        crossings[contact] = counts(tmp_path / f"{contact}.glb")
    assert crossings == {"off": (0, crossings["off"][1]), "resolve": (0, 0)}
    assert crossings["off"][1] > 50
    (fold,) = report.data["folds"]
    assert fold["joint"] is fold["degrees"] is None
    # The tool's shortening tells the weights, also in clips that were never baked.
    (made,) = track(tmp_path / "resolve.glb", [asset], tmp_path / "tracked")
    body, weights = (
        Gltf(tmp_path / "resolve.glb"),
        Gltf(Path(made.path)).weights("skin", "sneer", np.linspace(0, 2, 41)),
    )
    skin, bar = (body.attribute(node, "POSITION") for node in ("skin", "glasses"))
    triangles = np.concatenate([body.triangles("skin"), body.triangles("glasses") + len(skin)])
    crossing = Crossings.of(np.concatenate([skin, bar]), triangles)
    deltas = body.deltas("skin")
    contact = [body.mesh("skin")["extras"]["targetNames"].index(name) for name in fold["targets"]]
    left = np.zeros(2, int)
    for each in weights:
        for k, kept in enumerate((each, np.where(np.isin(np.arange(len(each)), contact), 0.0, each))):
            left[k] += len(crossing.at(np.concatenate([skin + np.tensordot(kept, deltas, axes=1), bar]))[0])
    assert left[0] == 0 < left[1]


def counts(path: Path) -> tuple[int, int]:
    """How often anything crosses, before wrinkles and after."""
    (clip,) = crossings(path).data["clips"]
    before, after = clip["totals"]
    return before, after


def test_only_nodes_with_a_mesh_are_ignored(tmp_path: Path) -> None:
    with pytest.raises(
        BakeError, match=r"tools\[0\]\.contact: node 'sleve' is no node with a mesh; did you mean 'sleeve'"
    ):
        baked(tmp_path, ignore=["sleve"])
