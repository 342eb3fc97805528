"""Goldens: what commands say of the samples is as it was when somebody last looked."""

from collections.abc import Callable
from pathlib import Path

import pytest

import wrinklecli
from kit.asset import Asset
from kit.bakes import bake_config
from kit.characters import low_poly
from kit.command import Wrinkle
from kit.flesh import body
from kit.golden import Golden
from kit.limb import limb_asset
from kit.places import ROOT
from kit.samples import sample
from kit.suggested import each_once


def trunk_with_a_spine() -> Asset:
    asset = body(keys=10)
    asset.gltf["nodes"][1]["name"] = "spine"
    return asset


# Assets that are made, or samples, and what to look for.
SUGGESTED: dict[str, tuple[Callable[[], Asset] | None, tuple[str, ...]]] = {
    "limb": (lambda: limb_asset(rings=14, sides=10, joints=3), ()),
    "muscles": (low_poly, ("--muscles",)),
    "flesh": (trunk_with_a_spine, ("--flesh",)),
    "wrist": (None, ()),
    "head": (None, ()),
    "trousers": (None, ()),
}


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", SUGGESTED)
def test_tools_are_suggested_as_before(name: str, tmp_path: Path, wrinkle: Wrinkle, golden: Golden) -> None:
    make, options = SUGGESTED[name]
    asset = make().write(tmp_path / f"{name}.glb").name if make else sample(name)
    with each_once():
        ran = wrinkle("suggest", asset, *options, "--verbose", "--json", "-o", "tools.yaml")
    golden.text("\n".join([(tmp_path / "tools.yaml").read_text(), *ran.lines, ran.out]), f"suggest_{name}.txt")


def test_tools_are_checked_as_before(golden: Golden) -> None:
    found = wrinklecli.check(sample("wrist"), ROOT / "configs" / "wrist.yaml", max_levels=1)
    golden([found.data, *found.warnings], "check_wrist.json")


def test_differences_are_as_before(golden: Golden) -> None:
    found = wrinklecli.diff(sample("wrist"), bake_config("wrist", "wrist").path)
    golden.text("\n".join(found.lines(20)), "diff_wrist.txt")
