"""Options of a bake, as a record or by name."""

from pathlib import Path

import pytest

import wrinklecli
from kit.limb import limb, write_tools
from wrinklecli.baking.job import BakeOptions


def test_options_are_a_record_or_named_or_both(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", sampling={"fps": 10})
    record = BakeOptions(max_levels=0, accessors="dense")
    made = [
        wrinklecli.bake(asset, tools, tmp_path / "record.glb", record),
        wrinklecli.bake(asset, tools, tmp_path / "named.glb", max_levels=0, accessors="dense"),
        wrinklecli.bake(asset, tools, tmp_path / "both.glb", BakeOptions(max_levels=0), accessors="dense"),
    ]
    assert made[0].data == made[1].data == made[2].data
    written = {(tmp_path / f"{name}.glb").read_bytes() for name in ("record", "named", "both")}
    assert len(written) == 1
    assert wrinklecli.BakeOptions is BakeOptions


def test_an_unknown_option_is_an_error(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml")
    with pytest.raises(TypeError, match="max_level"):
        wrinklecli.bake(asset, tools, tmp_path / "out.glb", max_level=0)
    assert not (tmp_path / "out.glb").exists()
