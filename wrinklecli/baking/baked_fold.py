"""The folds of a baked body over time: how far the joint of each turns, by the names that the extras give.

Source: the extras of `extras.encode_extras`, which say how.
"""

import numpy as np

from wrinklecli.baking.baked_body import BakedFold
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats, interpolated


def fold_weights(fold: BakedFold, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats) -> Floats:
    """(frames, targets) weights in a clip at (frames,) seconds; `joints` are nodes by name."""
    return interpolated(fold_angles(fold, rig, joints, clip, times), fold.angles, fold.table)


def fold_angles(fold: BakedFold, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats) -> Floats:
    """(frames,) radians that the joint turns about its axis, from the stored pose."""
    matrices = node_matrices(rig, clip, times, [joints[name] for name in fold.joints])[:, :, :3, :3]
    sizes = np.sqrt(np.sum(matrices**2, axis=2, keepdims=True))
    turns = matrices / np.where(sizes > 0, sizes, 1.0)
    own = turns[:, 0] if fold.parent is None else np.einsum("fba,fbc->fac", turns[:, 1], turns[:, 0])
    turned = own @ fold.rest.T
    # Of a rotation by an angle about a unit vector, both scaled alike: the vector times its sine, and its cosine.
    sines = np.stack([turned[:, (k + 2) % 3, (k + 1) % 3] - turned[:, (k + 1) % 3, (k + 2) % 3] for k in range(3)])
    return np.asarray(2.0 * np.arctan2(fold.axis @ sines, 1.0 + np.trace(turned, axis1=1, axis2=2)))
