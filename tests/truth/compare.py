"""Hold bakes against cloth that was simulated: `python compare.py FOLDER [SCENE]…`, after simulate.py.

Prints a table, and writes results.csv beside this module if all scenes were asked for.
"""

import csv
import sys
from dataclasses import astuple, fields, replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path += [str(HERE), str(HERE.parent), str(HERE.parent.parent)]

from bake import bake, played  # noqa: E402
from measure import Folds, arc_lengths, line_normals, measure  # noqa: E402
from relief import Relief  # noqa: E402
from scenes import SCENES, Array, Scene, share_of  # noqa: E402

from kit.asset import Json  # noqa: E402

FRAMES = (15, 22, 30, 38, 45, 53)  # from a quarter of the movement to its end, and half a second after
# Blender's cloth, and which material of ours is held against it.
LOOKS = {"denim": "cloth", "leather": "leather"}
# What is held against it: the material as it is; a tool along a path, which measures the surface's own shortening, and
# so takes nothing off it; and the same as tall as its length asks for, with edges short enough to keep that.
VARIANTS: dict[str, Json] = {
    "default": {},
    "path": {"path": True, "compressible": "0%"},
    "path, any height": {"path": True, "compressible": "0%", "max_height": "none"},
}
# Fields, which find by themselves where folds are, and which way they run; on tubes only: no joint turns on the strip.
# A fold is as high as its distance to the next asks for, so heights are compared at the simulation's distances too.
FIELDS = ("field", "field, distances as simulated")
# Of a strip as long as it likes a material cannot tell the bumps: those that the simulation has.
STRIP_BUMPS = {"denim": 5, "leather": 3}
COLUMNS = (
    *("scene", "cloth", "frame", "shorter", "what"),
    *(field.name for field in fields(Folds)),
    *("turned", "turned_far", "overlap", "aslant", "crest_length", "crest_width", "seconds"),
)


def tool_of(scene: Scene, cloth: str, variant: str) -> Json:
    """The tools file's list of a scene's one tool."""
    look: Json = {"material": LOOKS[cloth], **VARIANTS[variant]}
    if scene.body is None:
        look |= {"bumps": STRIP_BUMPS[cloth], "stops": "none"}  # folds run over its open sides
    ends = np.array([scene.origin, scene.target])
    if look.pop("path", False):
        look["path"] = [(ends[0] + share * (ends[1] - ends[0])).tolist() for share in np.linspace(0.0, 1.0, 9)]
    else:
        look |= {"origin": list(scene.origin), "target": list(scene.target)}
    return {"tools": [{"name": "fold", "width": scene.width, **look}]}


def field_of(cloth: str, wavelength: float | None = None) -> Json:
    """The tools file's list of a field over all of a scene's cloth."""
    length = {} if wavelength is None else {"wavelength": wavelength}
    return {"fields": [{"name": "folds", "material": LOOKS[cloth], **length}]}


def looks_of(scene: Scene, cloth: str, simulated: Array) -> dict[str, Json]:
    """The lists that are baked of a scene, by name."""
    found = {variant: tool_of(scene, cloth, variant) for variant in VARIANTS}
    if scene.sides:
        found |= dict(zip(FIELDS, (field_of(cloth), field_of(cloth, distance(scene, simulated))), strict=True))
    return found


def distance(scene: Scene, simulated: Array) -> float:
    """The median distance of simulated crests, m."""
    rest = scene.cloth.positions
    return float(np.median([folds(scene, simulated[frame], rest, frame).wavelength for frame in FRAMES]))


def folds(scene: Scene, positions: Array, rest: Array, frame: int) -> Folds:
    smooth = scene.posed(scene.cloth, share_of(frame))
    normals = line_normals(smooth, scene.cloth.quads, scene.lines)
    return measure(positions[scene.lines], smooth[scene.lines], normals, rest[scene.lines])


def read(folder: Path, scene: Scene, cloth: str) -> tuple[Array, float]:
    """(frames, vertices, 3) simulated positions, and seconds a frame."""
    with np.load(folder / f"{scene.name}_{cloth}.npz") as stored:
        return stored["positions"].astype(float), float(stored["seconds"].mean())


def rows_of(scene: Scene, cloth: str, folder: Path) -> list[tuple[object, ...]]:
    simulated, spent = read(folder, scene, cloth)
    baked, baked_rests = {}, {}
    for variant, listed in looks_of(scene, cloth, simulated).items():
        file, seconds = bake(scene, listed, folder / f"{scene.name}_{cloth}_{variant}")
        baked[variant], baked_rests[variant] = played(file, np.array(FRAMES)), file.attribute("cloth", "POSITION")
        print(
            f"{scene.name} {cloth} {variant}: simulated {spent:.3g} s a frame; baked in {seconds:.3g} s for all frames"
        )
    rows: list[tuple[object, ...]] = []
    rest, middle = scene.cloth.positions, scene.lines[len(scene.lines) // 2]
    apart = distance(scene, simulated)
    for number, frame in enumerate(FRAMES):
        base = scene.posed(scene.cloth, share_of(frame))
        shorter = 1.0 - _lengths(base, middle) / _lengths(rest, middle)
        every = {"simulated": (simulated[frame], spent)}
        every |= {f"baked, {name}": (posed[number], cost) for name, (posed, cost) in baked.items()}
        for what, (positions, cost) in every.items():
            found = folds(scene, positions, rest, frame)
            if what.startswith("baked"):
                fine = baked_rests[what.removeprefix("baked, ")]
                found = replace(found, arc=float(np.mean(arc_lengths(positions, fine, scene.lines))))
            relief = [float("nan")] * 6
            if scene.sides:
                true, ours = (
                    Relief.of(scene, each[: len(rest)], base, apart) for each in (simulated[frame], positions)
                )
                relief = [*true.turned(ours), true.overlap(ours), ours.aslant, *ours.crest]
            if what == "simulated":
                relief[:3] = [float("nan")] * 3
            rows.append((scene.name, cloth, frame, shorter, what, *astuple(found), *relief, cost))
    return rows


def _lengths(positions: Array, line: Array) -> float:
    return float(np.linalg.norm(np.diff(positions[line], axis=0), axis=1).sum())


def main() -> None:
    folder, *names = sys.argv[1:]
    scenes = [SCENES[name]() for name in names or SCENES]
    rows = [row for scene in scenes for cloth in LOOKS for row in rows_of(scene, cloth, Path(folder))]
    written = [[f"{each:.4g}" if isinstance(each, float) else each for each in row] for row in rows]
    for row in [COLUMNS, *written]:
        print(*(f"{each!s:>14}" for each in row))
    if not names:
        with (HERE / "results.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *written])


if __name__ == "__main__":
    main()
