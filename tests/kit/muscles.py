"""An upper arm and a forearm with a muscle, and its tools file."""

from pathlib import Path
from typing import Any

from kit.asset import Json
from kit.bakes import place
from kit.limb import RADIUS, limb_asset

# Greatest turn of the limb's joint: as far as an elbow bends.
ANGLE = 90.0


def muscle(**keys: Any) -> Json:
    """A muscle of a tools file, on the side of the limb towards which it folds."""
    origin = {"joint": "joint_0", "offset": [0.15, 0.4 * RADIUS, 0.0]}
    insertion = {"joint": "joint_1", "offset": [0.15, 0.4 * RADIUS, 0.0]}
    return {"name": "biceps", "origin": origin, "insertion": insertion, **keys}


def arm(**options: Any) -> Path:
    """A limb that folds by 90° in one second and back in the next; options as of `limb_asset`."""
    return place(limb_asset(**{"rings": 41, "sides": 24, "angle": ANGLE, **options}))
