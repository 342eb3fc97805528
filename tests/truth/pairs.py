"""Mix pictures of two kinds into blind pairs: `python pairs.py OUT SEED SOURCE`.

SOURCE is the folder of simulate.py, for ten pairs of a field and the simulation on one mesh, or a list of baked files
(YAML), such as `[{name: knees, clip: squat, field: a.glb, tools: b.glb}]`, of which each is drawn at rest, half way and
deepest; an `azimuth` turns the first of three sides. OUT gets 01_A.png, 01_B.png and so on, in an order that SEED
mixes, a contact sheet, and key.csv, which says what they are: keep it from those who judge.
"""

import csv
import random
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

HERE = Path(__file__).resolve().parent
sys.path += [str(HERE), str(HERE.parent), str(HERE.parent.parent)]

from bake import bake, played  # noqa: E402
from compare import field_of  # noqa: E402
from measure import line_normals  # noqa: E402
from scenes import SCENES, share_of  # noqa: E402

from wrinklecli.baking.baked_body import wrinkle_targets  # noqa: E402
from wrinklecli.baking.track import with_driven_weights  # noqa: E402
from wrinklecli.character.moved import Motions, moved  # noqa: E402
from wrinklecli.character.scene import deforming_nodes  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.review.preview.camera import Camera, camera_axes  # noqa: E402
from wrinklecli.review.preview.moments import Moment  # noqa: E402
from wrinklecli.review.preview.preview_options import Style  # noqa: E402
from wrinklecli.review.preview.rays import leave_room  # noqa: E402
from wrinklecli.review.preview.render import Snapshot, render  # noqa: E402
from wrinklecli.review.preview.shown import ShownAsset, read_shown, take_snapshot  # noqa: E402

Floats = NDArray[np.float64]
Picture = NDArray[np.uint8]

SIZE, FLAT = (440, 440), (440, 260)  # pixels, of a picture in a sheet: of a body, and of a limb that lies
# From the upper left, low over the surface: relief shows, and colours, which say what a mesh is, do not.
RAKING = Style(clay=True, key=(-0.80, 0.42, 0.43))
SIDES = (0.0, 180.0, 55.0)  # degrees from the first side: front, back, and aslant
ELEVATION = 5.0  # degrees
SEEN = 0.1  # of the greatest displacement, from which on something is looked at
SMALLER = 3  # of pixels, one remains in the contact sheet
# Scenes, cloths and frames of a simulation: from half of the movement to its end.
SIMULATED = [
    *((scene, "denim", frame) for scene in ("sleeve", "trousers") for frame in (22, 30, 45)),
    *((scene, "leather", frame) for scene in ("sleeve", "trousers") for frame in (30, 45)),
]
STEPS = 24  # moments at which a clip is searched for its deepest


@dataclass(frozen=True)
class Pair:
    """Two pictures of one thing by their kinds, such as `field` and `tools`."""

    name: str
    pictures: Mapping[str, Picture]


def sheet(
    rows: Sequence[Sequence[Snapshot]], cameras: Sequence[Sequence[Camera]], size: tuple[int, int] = SIZE
) -> Picture:
    """Draw snapshots beside and below one another, each by its camera."""
    drawn = [
        np.concatenate(
            [render(shown, camera, size=size, style=RAKING) for shown, camera in zip(*row, strict=True)], axis=1
        )
        for row in zip(rows, cameras, strict=True)
    ]
    return np.concatenate(drawn)


def mixed(pairs: Sequence[Pair], folder: Path, seed: int) -> None:
    """Write pairs in an order, and with a first of the two, that a seed draws, and the key to them."""
    folder.mkdir(parents=True, exist_ok=True)
    draw = random.Random(seed)
    rows, contact = [], []
    for number, pair in enumerate(draw.sample(list(pairs), len(pairs)), 1):
        kinds = draw.sample(sorted(pair.pictures), 2)
        for letter, kind in zip("AB", kinds, strict=True):
            Image.fromarray(pair.pictures[kind]).save(folder / f"{number:02}_{letter}.png")
        rows.append((number, pair.name, *kinds))
        contact.append(np.concatenate([pair.pictures[kind][::SMALLER, ::SMALLER] for kind in kinds], axis=1))
    Image.fromarray(np.concatenate(contact)).save(folder / "contact.png")
    with (folder / "key.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([("pair", "name", "A", "B"), *rows])


def of_simulation(name: str, cloth: str, frame: int, folder: Path) -> Pair:
    """The pair of a simulated moment and of a field on the same vertices, shaded by the same triangles."""
    scene = SCENES[name]()
    with np.load(folder / f"{name}_{cloth}.npz") as stored:
        simulated = stored["positions"][frame].astype(float)
    file, _ = bake(scene, field_of(cloth), folder / f"{name}_{cloth}_field")
    (ours,), _ = played(file, np.array([frame]))
    places = {"field": ours[: len(simulated)], "simulated": simulated}
    # Into the fold, and from both of its sides.
    half = np.radians(scene.turn * share_of(frame) / 2.0)
    axes = []
    for aside in (0.0, 0.7, -1.4):
        back = np.array([-np.sin(half), np.cos(half), aside])
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, -1.0], back)
        right /= np.linalg.norm(right)
        axes.append(np.array([right, np.cross(back, right), back]))
    both = np.concatenate(list(places.values()))
    cameras = [[Camera.framing(both, each, aspect=FLAT[0] / FLAT[1]) for each in axes]]
    triangles = scene.cloth.quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    pictures = {}
    for kind, points in places.items():
        normals = line_normals(points, scene.cloth.quads, triangles)
        grey = np.zeros((len(triangles), 3, 3))
        shown = Snapshot(points[triangles], normals, grey, grey[..., :2], np.full(len(triangles), -1))
        pictures[kind] = sheet([[shown] * len(axes)], cameras, FLAT)
    return Pair(f"{name}, {cloth}, frame {frame}", pictures)


def of_bakes(entry: Mapping[str, Any]) -> Pair:
    """The pair of two baked files."""
    listed = dict(entry)
    name, clip, azimuth = listed.pop("name"), listed.pop("clip"), float(listed.pop("azimuth", 0.0))
    assets = {kind: _read(Path(path), clip) for kind, path in listed.items()}
    moments = [Moment(clip, time) for time in _times(assets, clip)]
    axes = [camera_axes(azimuth + side, ELEVATION) for side in SIDES]
    # Both kinds are seen by the same cameras, which look at what either of them moves.
    points = [np.concatenate([_moved(asset, moment) for asset in assets.values()]) for moment in moments]
    cameras = [[Camera.framing(each, side, aspect=1.0) for each in points] for side in axes]
    pictures = {}
    for kind, asset in assets.items():
        snapshots = [take_snapshot(asset, moment, heat=False) for moment in moments]
        pictures[kind] = sheet([snapshots] * len(axes), cameras)
    return Pair(name, pictures)


def _read(path: Path, clip: str) -> ShownAsset:
    """A file with the clip, which may be one of its range of motion."""
    document = read_document(path)
    joined = moved(document, deforming_nodes(document), Motions(), driven=wrinkle_targets(document))
    driven, _ = with_driven_weights(joined.document, joined.added([clip]))
    return read_shown(driven, path.stem, ())[0]


def _moved(asset: ShownAsset, moment: Moment) -> Floats:
    """(vertices, 3) places at a moment of what the wrinkles move at any time."""
    found = []
    for shown, posed in asset.posed(moment):
        if len(shown.shape_numbers):
            most = np.abs(shown.shapes).max(axis=(0, 2))
            found.append(posed.positions[0][most > SEEN * most.max()])
    return np.concatenate(found)


def _times(assets: Mapping[str, ShownAsset], clip: str) -> list[float]:
    """The times at which the wrinkles of all assets are lowest, half as high, and highest, by their sums."""
    (first, *_) = assets.values()
    found = first.clip(clip)
    assert found is not None
    times = np.linspace(found.start, found.end, STEPS)
    heights = np.zeros(STEPS)
    for asset in assets.values():
        heard = asset.clip(clip)
        of_asset = [
            sum(float(shown.displacements(heard, t).sum()) for shown in asset.primitives if len(shown.shape_numbers))
            for t in times
        ]
        heights += np.array(of_asset) / max(max(of_asset), 1e-30)
    deepest = int(heights.argmax())
    half = int(np.abs(heights - (heights.min() + heights.max()) / 2).argmin())
    return [float(times[k]) for k in (int(heights.argmin()), half, deepest)]


def main() -> None:
    folder, seed, source = Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    leave_room()
    if source.is_dir():
        pairs = [of_simulation(*each, source) for each in SIMULATED]
    else:
        pairs = [of_bakes(entry) for entry in yaml.safe_load(source.read_text())]
    mixed(pairs, folder, seed)


if __name__ == "__main__":
    main()
