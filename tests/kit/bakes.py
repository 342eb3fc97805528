"""Bakes that several tests look at: each is made once in a run of the tests."""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema_rs import validator_for

import wrinklecli
from kit.asset import Asset, Json
from kit.kept import identity, kept
from kit.limb import limb_asset, tool
from kit.places import FOLDER, ROOT
from kit.player import Gltf
from kit.samples import sample
from wrinklecli.baking.report import Report

# What players are promised of the extras of every bake.
EXTRAS = validator_for(json.loads((ROOT / "samples" / "driver" / "extras.schema.json").read_text()))
# Options of a bake of which not much is asked.
COARSE: Json = {"max_levels": 1}
# Other keys of a tools file that refines nothing: contact takes two thirds of the time, or less.
UNREFINED: Json = {"refinement": {"max_levels": 0}}


@cache
def baked(asset: Path, text: str, options: str) -> Path:
    """The output of a bake.

    Args:
        asset: The asset, in one file.
        text: Of the tools file.
        options: Of `wrinklecli.bake`, as JSON.
    """

    def make(folder: Path) -> None:
        (folder / "tools.yaml").write_text(text)
        report = wrinklecli.bake(asset, folder / "tools.yaml", folder / "out.glb", **json.loads(options))
        (folder / "report.json").write_text(json.dumps([report.data, report.further_targets]))
        for node in Gltf(folder / "out.glb").json["nodes"]:
            if "wrinkle" in node.get("extras", {}):
                EXTRAS.validate(node["extras"]["wrinkle"])

    return kept(("bake", *identity(asset), text, options), make) / "out.glb"


@cache
def _read(path: Path) -> Gltf:
    """A file that no test changes, read once."""
    return Gltf(path)


def bake_once(asset: Path | str, *tools: Json, top: Json | None = None, fine: bool = False, **options: Any) -> Gltf:
    """Bake an asset (or a sample by its name); the same bake is made only once.

    Args:
        asset: The asset, in one file.
        tools: What a tools file lists.
        top: Its other keys.
        fine: Refine as far as the tools file says. Else an edge is halved once at most, unless `top` or `options` say
            otherwise: it takes a fifth of the time, and most tests ask what does not hang on it.
        options: Of `wrinklecli.bake`.
    """
    asset = sample(asset) if isinstance(asset, str) else asset
    listed = {"tools": list(tools)} if tools else {}
    text = yaml.safe_dump({"version": 1, **listed, **(top or {})})
    if not (fine or "refinement" in (top or {})):
        options = COARSE | options
    return _read(baked(asset, text, json.dumps(options, sort_keys=True)))


def bake_config(asset: str, config: str, *, fine: bool = False, **options: Any) -> Gltf:
    """Bake a sample with one of the bundled tools files, as `bake_once` does."""
    text = (ROOT / "configs" / f"{config}.yaml").read_text()
    return _read(baked(sample(asset), text, json.dumps(options if fine else COARSE | options, sort_keys=True)))


def report_of(file: Gltf) -> Report:
    """What a bake that is kept here said of itself."""
    data, further_targets = json.loads(file.path.with_name("report.json").read_text())
    return Report(data, further_targets=tuple(further_targets))


@cache
def folding_limb() -> Path:
    """A limb that folds so far that it goes through itself."""
    return place(limb_asset(angle=75.0, rings=16, sides=10))


def bake_fold(contact: str = "resolve", **options: Any) -> Gltf:
    """That limb with wrinkles in its fold, whose contact is resolved or not."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    crease = tool(bumps=3, max_height="10%", contact=contact)
    return bake_once(folding_limb(), crease, top={"refinement": {"max_levels": 1}}, **options)


def place(asset: Asset, ending: str = ".glb") -> Path:
    """Write an asset into a folder of its own."""
    return asset.write(Path(tempfile.mkdtemp(dir=FOLDER)) / f"limb{ending}")
