"""The drive of a touch: how far a tip has slid the skin, and the weights of slide, dent and rings that follow from it.

The slide d has a part forward and a part sideways. Its shapes are those of an elastic skin, which is linear, so their
weights are d / `grip`, made positive as those of flesh: the least number, if it is below 0, is taken from both, and the
third target, equal to minus the sum of the others, gets it. The dent's weight is the depth of the tip below the skin
over `deepest`. A ring rises with f(|d| / grip) · cos(angle of d - angle of its window), where f is a table that starts
like a square root, as all wrinkles do.

In clips, slides and depths are keyed, straight between keys, and held before the first one. After the last one the tip
lets go, and the skin springs back: x'' = -ω² x - 2 ζ ω x'.

In extras, a drive has the `anchors` of its place (the middle, and a point before and beside it), `pad`, `grip` and
`deepest` in scene units, `release` with `frequency` and `damping`, `windows` in radians, `rises` (rows of slide over
grip and weight), and by clip `keys`: rows of seconds, slide forward and sideways, and depth, scene units.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.point import point_json, read_point
from wrinklecli.drive.swing import nonnegative
from wrinklecli.drive.table import Json, stored
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.numeric.spring import Spring

# Greatest frequency in hertz and damping ratio of a spring that extras may ask for: more than a bake writes.
_MOST = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class TouchDrive:
    """A tip that slides the skin of one place.

    Attributes:
        name: The touch's name.
        anchors: The middle of the place, and points of the skin before and beside it.
        pad: Radius of the tip, scene units.
        grip: Greatest slide, scene units.
        deepest: Greatest depth, scene units.
        release: The spring by which the skin comes back.
        windows: (windows,) directions of the rings' windows, radians.
        rises: (rows, 2) slides over the greatest, and weights of the rings; sorted.
        targets: Names of the morph targets: slide forward, sideways and back, dent, and the windows.
        keys: By clip, (keys, 4) seconds, slides forward and sideways, and depths, scene units.
    """

    name: str
    anchors: tuple[CarriedPoint, ...]
    pad: float
    grip: float
    deepest: float
    release: Spring
    windows: Floats
    rises: Floats
    targets: tuple[str, ...]
    keys: Mapping[str, Floats] = field(default_factory=dict)

    own: ClassVar[tuple[str, ...]] = ()
    slides: ClassVar[int] = 4
    """Targets before those of the rings."""

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes that carry the place."""
        return frozenset(node for point in self.anchors for node in point.nodes.tolist())

    def contacts_in(self, clip: Clip | None) -> Callable[[Floats], Floats]:
        """A function from (frames,) seconds of a clip to (frames, 3) slides forward and sideways and depths."""
        keys = None if clip is None else self.keys.get(clip.name)
        if keys is None:
            return lambda times: np.zeros((len(times), 3))
        return lambda times: self._followed(keys, times)

    def _followed(self, keys: Floats, times: Floats) -> Floats:
        """(frames, 3) slides and depths by (keys, 4) keys."""
        found = np.stack([np.interp(times, keys[:, 0], column) for column in keys[:, 1:].T], axis=1)
        cosine, sine = self.release.decay(self.release.speed * np.maximum(times - keys[-1, 0], 0.0))
        found *= (cosine + self.release.damping * sine)[:, None]
        found[:, 2] = np.maximum(found[:, 2], 0.0)
        return found

    def weights(self, contacts: Floats) -> Floats:
        """(frames, targets) weights for (frames, 3) slides forward and sideways and depths, scene units."""
        slides, depths = contacts[:, :2] / self.grip, contacts[:, 2] / self.deepest
        lengths = np.sqrt((slides**2).sum(axis=1))
        # Beyond its grip the tip slips.
        slides = slides / np.maximum(lengths, 1.0)[:, None]
        lengths = np.minimum(lengths, 1.0)
        ways = slides / np.maximum(lengths, 1e-12)[:, None]
        ahead = ways @ np.stack([np.cos(self.windows), np.sin(self.windows)])
        rings = np.interp(lengths, *self.rises.T)[:, None] * np.maximum(ahead, 0.0)
        return np.concatenate([nonnegative(slides), np.clip(depths, 0.0, 1.0)[:, None], rings], axis=1)

    def weights_in(self, _rig: Rig, clip: Clip | None) -> Signal:
        """A function from (frames,) seconds of a clip to (frames, targets) weights; None is the stored pose."""
        contacts = self.contacts_in(clip)
        return lambda times: self.weights(contacts(times))

    def to_json(self, names: Sequence[str], morph_names: Sequence[str]) -> Json:
        """The drive as extras store it, by the names of all nodes and of the rig's morph targets."""
        return {
            "name": self.name,
            "anchors": [point_json(point, names, morph_names) for point in self.anchors],
            "pad": stored(self.pad),
            "grip": stored(self.grip),
            "deepest": stored(self.deepest),
            "release": {
                "frequency": stored(self.release.speed / (2.0 * np.pi)),
                "damping": stored(self.release.damping),
            },
            "windows": stored(self.windows),
            "rises": stored(self.rises, 5),
            **({"keys": {clip: stored(keys) for clip, keys in self.keys.items()}} if self.keys else {}),
            "targets": list(self.targets),
        }


def read_touch(data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> TouchDrive:
    """Read a drive of a touch in extras, on a rig whose nodes have these numbers by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    pad, grip, deepest = (float(data[key]) for key in ("pad", "grip", "deepest"))
    frequency, damping = (float(data["release"][key]) for key in ("frequency", "damping"))
    windows = np.array(data["windows"], np.float64).reshape(-1)
    rises = np.array(data["rises"], np.float64).reshape(-1, 2)
    keys = {clip: np.array(each, np.float64).reshape(-1, 4) for clip, each in data.get("keys", {}).items()}
    targets = tuple(str(name) for name in data["targets"])
    positive = min(pad, grip, deepest) > 0 and 0 < frequency < _MOST and 0 < damping < _MOST
    rising = all(len(each) and (np.diff(each[:, 0]) > 0).all() for each in keys.values())
    finite = all(np.isfinite(each).all() for each in (windows, rises, *keys.values()))
    if not (positive and rising and finite) or len(targets) != TouchDrive.slides + len(windows):
        raise ValueError
    if len(windows) and (not len(rises) or not (np.diff(rises[:, 0]) > 0).all()):
        raise ValueError
    anchors = tuple(read_point(each, nodes, morph_names) for each in data["anchors"])
    spring = Spring(2.0 * np.pi * frequency, damping)
    return TouchDrive(str(data["name"]), anchors, pad, grip, deepest, spring, windows, rises, targets, keys)
