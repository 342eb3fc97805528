"""Joins the weights of new morph targets with the weights channel that a clip already has.

A weights channel drives all targets of a mesh or none, so an existing channel is widened. It keeps its own keys and
interpolation if that loses nothing.

Source: glTF 2.0 §3.11 and appendix C.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Channel, Clip, linear_keys, sample, spline_slopes
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, distinct_values, interpolated


@dataclass(frozen=True, slots=True)
class Track:
    """A weights channel to write.

    Attributes:
        times: (keys,) seconds, float32 values.
        values: (keys, targets), or (keys, 3, targets) for CUBICSPLINE.
        interpolation: LINEAR, STEP or CUBICSPLINE.
    """

    times: Floats
    values: Floats
    interpolation: str


def by_names(values: Floats, names: Sequence[str], wanted: Sequence[str], stored: Floats) -> Floats:
    """(keys, wanted), or (keys, 3, wanted), of the values of morph targets with some names; others are as stored."""
    found = np.zeros((*values.shape[:-1], len(wanted)))
    points = found if found.ndim == 2 else found[:, 1]  # of a cubic, between its tangents
    points[:] = stored
    for column, name in enumerate(wanted):
        if name in names:
            found[..., column] = values[..., names.index(name)]
    return found


def widen(channel: Channel | None, rig: Rig, clip: Clip, times: Floats, weights: Floats) -> Track:
    """Join (frames, new targets) weights at (frames,) seconds with a clip's weights channel of the old targets, if any.

    LINEAR keeps its values at the union of key times. STEP becomes LINEAR with an extra key a millisecond before each
    jump (see `linear_keys`). CUBICSPLINE stays: its pieces are split at new keys by Hermite subdivision, and new
    weights get the secants as tangents.
    """
    if channel is None:
        old = morph_weights(rig, None, times)
        return Track(times, np.concatenate([old, weights], axis=1), "LINEAR")
    if channel.interpolation == "CUBICSPLINE":
        return _widen_spline(channel, times, weights)
    union = distinct_values(np.concatenate([times, linear_keys(channel)]))
    old = morph_weights(rig, clip, union)
    return Track(union, np.concatenate([old, interpolated(union, times, weights)], axis=1), "LINEAR")


def pad(channel: Channel, added: Floats) -> Track:
    """Add (new targets,) constant weights to a clip's weights channel, whose keys are kept."""
    if channel.fault is not None:
        raise channel.fault
    values = channel.values
    constant = np.broadcast_to(added, (*values.shape[:-1], len(added))).copy()
    if channel.interpolation == "CUBICSPLINE":
        constant[:, [0, 2]] = 0.0
    return Track(channel.times, np.concatenate([values, constant], axis=-1), channel.interpolation)


def _widen_spline(channel: Channel, times: Floats, weights: Floats) -> Track:
    """Widen a CUBICSPLINE channel."""
    union = distinct_values(np.concatenate([times, channel.times]))
    values = sample(channel, union)
    into, out = spline_slopes(channel, union)
    fresh = interpolated(union, times, weights)
    slopes = np.diff(fresh, axis=0) / np.diff(union)[:, None] if len(union) > 1 else np.zeros((0, fresh.shape[1]))
    edge = np.zeros((1, fresh.shape[1]))
    # If the tangents at both ends are its secant, a Hermite piece is a straight line.
    fresh_into, fresh_out = np.concatenate([edge, slopes]), np.concatenate([slopes, edge])
    stacked = [np.concatenate(pair, axis=1) for pair in ((into, fresh_into), (values, fresh), (out, fresh_out))]
    return Track(union, np.stack(stacked, axis=1), "CUBICSPLINE")
