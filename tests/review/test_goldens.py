"""Goldens: what commands say of the samples is as it was when somebody last looked."""

import pytest

import wrinklecli
from kit.bakes import bake_config, place
from kit.golden import Golden
from kit.limb import limb_asset
from kit.places import ROOT
from kit.samples import sample
from kit.suggested import suggest_once


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["limb", "wrist", "head", "trousers"])
def test_tools_are_suggested_as_before(name: str, golden: Golden) -> None:
    asset = place(limb_asset(rings=14, sides=10, joints=3)) if name == "limb" else sample(name)
    found = suggest_once(asset)
    golden.text("\n".join([found.text, *found.notes]), f"suggest_{name}.txt")


def test_tools_are_checked_as_before(golden: Golden) -> None:
    found = wrinklecli.check(sample("wrist"), ROOT / "configs" / "wrist.yaml", max_levels=1)
    golden([found.data, *found.warnings], "check_wrist.json")


def test_differences_are_as_before(golden: Golden) -> None:
    found = wrinklecli.diff(sample("wrist"), bake_config("wrist", "wrist").path)
    golden.text("\n".join(found.lines(20)), "diff_wrist.txt")
