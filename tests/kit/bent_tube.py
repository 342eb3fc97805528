"""A tube that bends through itself, for the solver of contact alone: its surface, and where skinning wants it."""

import numpy as np

from wrinklecli.effects.contact.tissue import UNITS, SkinnedPose

RINGS, SIDES = 16, 10


def tube(radius: float, *, length: float = 6 * UNITS) -> tuple[np.ndarray, np.ndarray]:
    """A tube along x, open at its ends, of the solver's units: positions and triangles."""
    x, turn = np.linspace(-length / 2, length / 2, RINGS), 2 * np.pi * np.arange(SIDES) / SIDES
    places = np.stack(np.broadcast_arrays(x[:, None], radius * np.cos(turn), radius * np.sin(turn)), axis=2)
    a = np.arange((RINGS - 1) * SIDES)
    b = a - a % SIDES + (a + 1) % SIDES
    triangles = np.concatenate([np.stack([a, b, a + SIDES], 1), np.stack([b, b + SIDES, a + SIDES], 1)])
    return places.reshape(-1, 3), triangles


def bent(rest: np.ndarray, angle: float, width: float, bump: float) -> SkinnedPose:
    """Bent about z by linear blend skinning, towards +y, with bumps that rise on the inside of the bend.

    Args:
        rest: (vertices, 3) of a tube.
        angle: Radians.
        width: Over which skin weights change.
        bump: How high bumps rise with each radian.
    """
    share = np.clip(rest[:, 0] / width + 0.5, 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    matrices = (1 - share)[:, None, None] * np.eye(3) + share[:, None, None] * turned
    inside = np.clip(rest[:, 1] / np.abs(rest[:, 1]).max(), 0, 1)
    high = rest + bump * angle * inside[:, None] * np.exp(-((np.abs(rest[:, 0]) / 40 - 1) ** 2))[:, None] * [0, 1, 0]
    return SkinnedPose(np.einsum("vij,vj->vi", matrices, high), matrices)
