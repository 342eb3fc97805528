"""Entries of reports and warnings about regions of flesh."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.swing import KEYS_ASKED, SwingDrive, keys_per_second, signed
from wrinklecli.effects.effect import Motion
from wrinklecli.errors import listed
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.tools.body import Flesh

# Part of the limit below which nobody sees a region move.
_SEEN = 0.02
# Body heights per second at which the ground runs below a clip in place: a slow walk has 0.4, a shifted foot 0.05. And
# the part of the ground's way within which such a body keeps its place: one that goes ahead gets as far as its feet do.
_RUNS, _SWAYS = 0.15, 0.25
# Samples per second, and at most, by which that is measured: a foot is down for a quarter of a second in a run.
_SAMPLED, _MOST_SAMPLES = 30.0, 300


class _Region(Protocol):
    """The entry of an `AttachedFlesh`."""

    @property
    def tool(self) -> Flesh: ...

    @property
    def drive(self) -> SwingDrive: ...

    @property
    def limit(self) -> float: ...

    @property
    def covers(self) -> Sequence[str]: ...


def describe_swing(attached: _Region, motion: Motion, weights: Floats) -> Json:
    """A region's entry in a clip: its greatest move, scene units, and the seconds for which it stands at its limit."""
    moves = _moves(weights)
    # At its limit a load, of which |n|⁴ does not act, would move it at least twice as far without.
    held = moves**4 > 0.5
    seconds = float((np.diff(motion.times) * (held[1:] & held[:-1])).sum())
    return {
        "name": attached.tool.name,
        "largest_move": significant(attached.limit * float(moves.max(initial=0.0)), 4),
        "seconds_at_limit": significant(seconds, 4),
    }


def region_warnings(attached: _Region, rig: Rig, clips: Sequence[tuple[Clip, Floats]]) -> list[str]:
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
    still = bool(clips) and all(_moves(weights).max(initial=0.0) < _SEEN for _, weights in clips)
    # Of clips in place, the layer has told.
    if still and not any(in_place(rig, clip) for clip, _ in clips):
        warnings.append(
            f"{name}: hardly moves in {listed([clip.name for clip, _ in clips])}, where {rig.names[node]!r} keeps its"
            " place: a clip in place holds no motion of the root, which only a player adds, and a driver in the player"
            " follows"
        )
    return warnings


def in_place(rig: Rig, clip: Clip) -> bool:
    """True if a body walks or runs in a clip, but keeps its place.

    The lowest joint is that of the foot which stands. Where the clip moves the body ahead, the foot keeps its place;
    in place, it slides backwards again and again. A leg that swings to and fro does not get anywhere.
    """
    count = int(np.clip(_SAMPLED * (clip.end - clip.start), 2, _MOST_SAMPLES)) + 1
    times = np.linspace(clip.start, clip.end, count)
    # A root joint may lie on the ground and stay there; toes, fingers and the like have no joint below them.
    ends = np.setdiff1d(rig.joints, rig.parents)
    rows = node_rows(rig, clip, times, ends.tolist())
    places = np.stack([np.broadcast_to(each[:, 3], (3, count)).T for each in rows])
    size = float(np.ptp(places[:, 0], axis=0).max())
    if not size > 0 or not clip.end > clip.start:
        return False
    lowest = (places[:, 1:, 1] + places[:, :-1, 1]).argmin(axis=0)
    steps = np.diff(places[:, :, [0, 2]], axis=1)
    run = float(np.linalg.norm(steps[lowest, np.arange(count - 1)].sum(axis=0)))
    way = float(np.ptp(places[:, :, [0, 2]].mean(axis=0), axis=0).max())
    return run > _RUNS * size * (clip.end - clip.start) and way < _SWAYS * run


def _moves(weights: Floats) -> Floats:
    """(frames,) moves over the limit, from (frames, targets) weights."""
    return np.asarray(np.sqrt((signed(weights) ** 2).sum(axis=1)))
