"""Goldens: what commands say of the samples is as it was when somebody last looked."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.asset import Asset, Json
from kit.bakes import bake_config, place
from kit.characters import low_poly
from kit.command import Wrinkle
from kit.fields import sleeve
from kit.flesh import body
from kit.golden import Golden, summed
from kit.limb import limb_asset
from kit.places import ROOT
from kit.samples import sample
from kit.suggested import each_once
from wrinklecli.character.bones import read_bones
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.guard import log_progress
from wrinklecli.review.suggest.candidates import find_candidates
from wrinklecli.review.suggest.measure import find_mesh_nodes, measure_meshes
from wrinklecli.review.suggest.suggest_options import SuggestOptions


def trunk_with_landmarks() -> Asset:
    """A trunk, and joints of legs and a neck that move no skin."""
    asset = body(keys=10)
    trunk = asset.gltf["nodes"][1]
    trunk["name"] = "spine"
    places = {"neck": [0.0, 0.3, 0.0]}
    for side, x in (("L", 0.08), ("R", -0.08)):
        places |= {f"UpperLeg.{side}": [x, -0.15, 0.0], f"LowerLeg.{side}": [x, -0.5, 0.0]}
    added = [asset.append("nodes", {"name": name, "translation": place}) for name, place in places.items()]
    trunk["children"] = [*trunk.get("children", []), *added]
    return asset


def limb_that_bends_and_turns() -> Asset:
    """A limb beside the plane of symmetry, whose fold runs askew, so that a tool across it is a path."""
    asset = limb_asset(rings=16, sides=10, root={"translation": [0.3, 0.1, 0.2]})
    bend, turn = np.radians([40.0, 30.0])
    both = [np.cos(bend) * np.sin(turn), np.sin(bend) * np.sin(turn), np.sin(bend) * np.cos(turn)]
    still: Json = [0.0, 0.0, 0.0, 1.0]
    screw: Json = {"name": "screw"}
    asset.channel(screw, 2, "rotation", [0.0, 1.0, 2.0], [still, [*both, np.cos(bend) * np.cos(turn)], still])
    asset.gltf["animations"] = [screw]
    return asset


# Assets that are made, or samples, and what to look for.
SUGGESTED: dict[str, tuple[Callable[[], Asset] | None, tuple[str, ...]]] = {
    "limb": (limb_that_bends_and_turns, ("--all",)),
    "muscles": (low_poly, ("--muscles",)),
    "flesh": (trunk_with_landmarks, ("--flesh",)),
    "wrist": (None, ()),
    "trousers": (None, ()),
}


@pytest.mark.quick(2, 2)
@pytest.mark.parametrize("name", SUGGESTED)
def test_tools_are_suggested_as_before(name: str, tmp_path: Path, wrinkle: Wrinkle, golden: Golden) -> None:
    make, options = SUGGESTED[name]
    asset = make().write(tmp_path / f"{name}.glb").name if make else sample(name)
    with each_once():
        ran = wrinkle("suggest", asset, *options, "--verbose", "--json", "-o", "tools.yaml")
    golden.text("\n".join([(tmp_path / "tools.yaml").read_text(), *ran.lines, ran.out]), f"suggest_{name}.txt")


def test_folds_are_measured_as_before(golden: Golden) -> None:
    """Sites of a surface, their losses and their regions make suggestions, and are held before they are rounded."""
    document = read_document(place(sleeve(root={"translation": [0.3, 0.1, 0.2]})))
    options = SuggestOptions()
    nodes, _ = find_mesh_nodes(document, options)
    ((mesh, peaks),) = measure_meshes(document, nodes, read_clips(document), options, log_progress)
    sites = mesh.sites
    found = find_candidates([(mesh, peaks)], read_bones(document).parts, log_progress, jobs=1)
    arrays = (sites.positions, sites.normals, sites.areas, sites.gather.toarray(), sites.smooth.toarray(), peaks.losses)
    regions = [
        {
            **{name: getattr(each, name) for name in ("origin", "target", "time", "score", "driver")},
            **{
                name: getattr(each.region, name)
                for name in ("centre", "normal", "along", "length", "width", "on_plane")
            },
            "weights": summed(each.region.weights),
        }
        for each in found
    ]
    golden([[summed(each) for each in arrays], regions], "measured_sleeve.json")


def test_tools_are_checked_as_before(golden: Golden) -> None:
    found = wrinklecli.check(sample("wrist"), ROOT / "configs" / "wrist.yaml", max_levels=1)
    golden([found.data, *found.warnings], "check_wrist.json")


@pytest.mark.slow
def test_differences_are_as_before(golden: Golden) -> None:
    found = wrinklecli.diff(sample("wrist"), bake_config("wrist", "wrist").path)
    golden.text("\n".join(found.lines(20)), "diff_wrist.txt")
