"""Bakes that several tests look at, each made once."""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import yaml

import wrinklecli
from kit.asset import Asset, Json
from kit.places import FOLDER, ROOT
from kit.player import Gltf
from kit.samples import sample


@cache
def _baked(asset: Path, text: str, options: str) -> Path:
    folder = Path(tempfile.mkdtemp(dir=FOLDER))
    tools = folder / "tools.yaml"
    tools.write_text(text)
    wrinklecli.bake(asset, tools, folder / "out.glb", **json.loads(options))
    return folder / "out.glb"


@cache
def _read(path: Path) -> Gltf:
    """A file that no test changes, read once."""
    return Gltf(path)


def bake_once(asset: Path | str, *tools: Json, top: Json | None = None, **options: Any) -> Gltf:
    """Bake an asset (or a sample by its name); the same bake is made only once."""
    asset = sample(asset) if isinstance(asset, str) else asset
    text = yaml.safe_dump({"version": 1, "tools": list(tools), **(top or {})})
    return _read(_baked(asset, text, json.dumps(options, sort_keys=True)))


def bake_config(asset: str, config: str, **options: Any) -> Gltf:
    """Bake a sample with one of the bundled tools files."""
    text = (ROOT / "configs" / f"{config}.yaml").read_text()
    return _read(_baked(sample(asset), text, json.dumps(options, sort_keys=True)))


def place(asset: Asset, ending: str = ".glb") -> Path:
    """Write an asset into a folder of its own."""
    return asset.write(Path(tempfile.mkdtemp(dir=FOLDER)) / f"limb{ending}")
