"""Entries of reports and warnings about regions of flesh."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.swing import KEYS_ASKED, keys_per_second, signed
from wrinklecli.effects.effect import Motion
from wrinklecli.effects.flesh.attach import AttachedFlesh
from wrinklecli.errors import listed
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

# Part of the limit below which nobody sees a region move.
_SEEN = 0.02
# Part of the limit, after the cap, beyond which flesh stands at its limit: it would move twice as far without.
_CAPPED = 0.96


def describe_swing(attached: AttachedFlesh, motion: Motion, weights: Floats) -> Json:
    """A region's entry in a clip: its greatest move, scene units, and the seconds for which the cap holds it."""
    moves = _moves(weights)
    held = moves > _CAPPED
    seconds = float((np.diff(motion.times) * (held[1:] & held[:-1])).sum())
    return {
        "name": attached.tool.name,
        "largest_move": significant(attached.limit * float(moves.max(initial=0.0)), 4),
        "seconds_at_limit": significant(seconds, 4),
    }


def region_warnings(attached: AttachedFlesh, rig: Rig, clips: Sequence[tuple[Clip, Floats]]) -> list[str]:
    """Warnings about clips that say too little of how a region moves."""
    name, node, warnings = attached.tool.name, attached.drive.node, []
    if attached.tool.carrier is not None:
        return []  # those of the region's own mesh say it
    sparse = [(keys_per_second(rig, clip, node), clip.name) for clip, _ in clips]
    few = [(keys, clip) for keys, clip in sparse if keys < KEYS_ASKED]
    if few:
        warnings.append(
            f"{name}: {listed([clip for _, clip in few])} has {min(few)[0]:.3g} keys a second for {rig.names[node]!r}"
            f" and what it hangs on; below {KEYS_ASKED:g}, flesh swings as the keys do and not as the body would:"
            " export the clip with a key for each frame"
        )
    if attached.covers:
        stay = "stays" if len(attached.covers) == 1 else "stay"
        warnings.append(
            f"{name}: {listed(attached.covers)} over it {stay} in place: the skin may come through; `meshes` lets"
            " clothes move along"
        )
    if clips and all(_moves(weights).max(initial=0.0) < _SEEN for _, weights in clips):
        warnings.append(
            f"{name}: hardly moves in {listed([clip.name for clip, _ in clips])}, where {rig.names[node]!r} keeps its"
            " place: a clip in place holds no motion of the root, which only a player adds, and a driver in the player"
            " follows"
        )
    return warnings


def _moves(weights: Floats) -> Floats:
    """(frames,) moves over the limit, from (frames, targets) weights."""
    return np.asarray(np.sqrt((signed(weights) ** 2).sum(axis=1)))
