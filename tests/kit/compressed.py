"""The sample `wrist` as compressors leave it; data/README.md says how the files were made."""

import json
from pathlib import Path

DATA = Path(__file__).resolve().parents[1] / "data"
DECODED: dict[str, list[str]] = json.loads((DATA / "decoded.json").read_text())
MESHOPT = sorted(DECODED)
EVERY = [*MESHOPT, "gltf_transform_draco"]


def compressed_sample(name: str) -> Path:
    """The file of that name in `tests/data`."""
    return DATA / f"{name}.glb"
