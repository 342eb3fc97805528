"""Other meshes beside a fold whose contact is resolved: wrinkles stay on their side, unless these are ignored."""

from pathlib import Path

import pytest

import wrinklecli
from kit.limb import sleeved_limb, tool, write_tools
from wrinklecli.errors import BakeError
from wrinklecli.review.crossings import find_crossings


def baked(folder: Path, *, joined: bool = False, **contact: object) -> tuple[int, int]:
    """How often a limb crosses its sleeve, of a mesh of its own or joined with the limb's, before and after a bake."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    asset = sleeved_limb(gap=0.05, rings=12, sides=8, angle=32.0)
    if joined:
        asset.gltf["meshes"][0]["primitives"] += asset.gltf["meshes"][1]["primitives"]
        asset.gltf["scenes"][0]["nodes"].pop()
    entry = tool(node="limb", bumps=2, max_height="10%", contact=contact)
    tools = write_tools(folder / "tools.yaml", entry, refinement={"max_levels": 0})
    wrinklecli.bake(asset.write(folder / "limb.glb"), tools, folder / "out.glb")
    (clip,) = find_crossings(folder / "out.glb").data["clips"]
    before, after = clip["totals"]
    return before, after


@pytest.mark.slow
def test_wrinkles_stay_beneath_a_sleeve(tmp_path: Path) -> None:
    assert baked(tmp_path) == (0, 0)


@pytest.mark.slow
def test_wrinkles_stay_beneath_a_sleeve_of_the_same_mesh(tmp_path: Path) -> None:
    assert baked(tmp_path, joined=True) == (0, 0)


@pytest.mark.parametrize(("node", "joined"), [("sleeve", False), pytest.param("limb", True, marks=pytest.mark.slow)])
def test_a_mesh_that_is_ignored_is_gone_through(node: str, joined: bool, tmp_path: Path) -> None:
    before, after = baked(tmp_path, joined=joined, ignore=[node])
    assert before == 0
    assert after > 10


def test_only_nodes_with_a_mesh_are_ignored(tmp_path: Path) -> None:
    with pytest.raises(
        BakeError, match=r"tools\[0\]\.contact: node 'sleve' is no node with a mesh; did you mean 'sleeve'"
    ):
        baked(tmp_path, ignore=["sleve"])
