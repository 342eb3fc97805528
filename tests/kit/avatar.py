"""An avatar as crowds have them: one mesh of 30,000 triangles, and 250 joints, of which hair and a skirt have most.

No asset that others made and that may be kept with the project has so many joints; files of avatars that people
exchange often do. The command `python tests/kit/avatar.py FOLDER` writes it with and without clips.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from kit.asset import Asset
from kit.characters import MIXAMO, Surface, Weights, Writer, person, plain

# Strands of hair and of a skirt, and joints of each: with the 25 of a body they are 250.
_HAIR, _HAIR_JOINTS = 36, 5
_SKIRT, _SKIRT_JOINTS = 9, 5


def avatar(*, clips: bool, coarse: bool = False) -> Asset:
    """The avatar, with clips or without any; a coarse one has a third of the triangles, and all of the joints."""
    writer = Writer(twist=True, names=MIXAMO)
    columns, rows, sides = (24, 11, 4) if coarse else (52, 24, 10)
    body = person(columns=columns, rows=rows, twist=True)
    hair = ((0.1, 1.7, 0.11), (0.13, 1.55, 0.14), (0.14, 1.3, 0.15))
    skirt = ((0.18, 0.98, 0.13), (0.24, 0.8, 0.19), (0.3, 0.55, 0.25))
    for name, parent, count, joints, profile, radius in (
        ("hair", "head", _HAIR, _HAIR_JOINTS, hair, 0.008),
        ("skirt", "hips", _SKIRT, _SKIRT_JOINTS, skirt, 0.03),
    ):
        for number in range(count):
            turn = 2.0 * np.pi * number / count
            points = [(across * np.sin(turn), y, -along * np.cos(turn)) for across, y, along in profile]
            _strand(writer, body, f"{name}_{number}", parent, joints, points, radius=radius, sides=sides)
    writer.mesh("avatar", body, {"": plain("skin", (0.8, 0.6, 0.5))})
    if clips:
        times = np.linspace(0.0, 2.0, 9)
        bend = 100.0 * np.sin(np.pi * times / 2.0) ** 2
        writer.clip("squat", times, {
            f"{name}.{side}": ("x", factor * bend)
            for side in "LR" for name, factor in (("thigh", -0.9), ("shin", 1.2), ("foot", -0.3))
        }, sinks=0.004 * bend)  # fmt: skip
        writer.clip("curl", times, {f"forearm.{side}": ("y", sign * bend) for side, sign in (("L", -1.0), ("R", 1.0))})
    return writer.finish()


def _strand(
    writer: Writer, body: Surface, name: str, parent: str, count: int, points: list[tuple[float, float, float]],
    *, radius: float, sides: int,
) -> None:  # fmt: skip
    """Hang a chain of joints with a tube round it along some places, which are spread evenly over it."""
    along = np.linspace(0.0, 1.0, 3 * count + 1)
    places = np.stack(
        [np.interp(along, np.linspace(0.0, 1.0, len(points)), each) for each in zip(*points, strict=True)]
    )
    chain = []
    for number, place in enumerate(places.T[:-1:3]):
        parent = writer.joint(f"{name}_{number}", parent, tuple(place.tolist()))
        chain.append(parent)
    weights: list[Weights] = []
    for place in along * count:
        first, share = min(int(place), count - 1), place - int(place)
        after = min(first + 1, count - 1)
        weights.append(
            {chain[first]: 1.0} if first == after or not share else {chain[first]: 1 - share, chain[after]: share}
        )
    body.tube(places.T, radius, weights, name.partition("_")[0], sides=sides, across=(0.0, 0.0, 1.0))


if __name__ == "__main__":
    for has_clips in (True, False):
        avatar(clips=has_clips).write(Path(sys.argv[1]) / f"avatar_{'clips' if has_clips else 'still'}.glb")
