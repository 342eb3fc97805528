"""Numbers as extras hold them."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from wrinklecli.numeric.arrays import Floats, significant

TAUT = 1 - 1e-5
"""Part of the rest length below which wrinkles start, as rounding noise of 1e-7 alone would raise 6e-5 l."""

Json: TypeAlias = dict[str, Any]

DIGITS = 8
"""Significant decimal digits: those of float32."""

MOST_KEPT = 64
"""Clips whose motion a drive keeps: the same one is asked for at many times."""

# Greatest frequency, in hertz, and damping ratio of a spring that extras may ask for: more than a bake writes.
_MOST = 1e4


def read_numbers(values: object, *shape: int) -> Floats:
    """Finite numbers in extras as an array of a shape.

    Raises:
        ValueError: There are others: JSON's 1e999 is infinite, and the text "nan" would count as a number.
    """
    found = np.array(values)
    if found.dtype.kind not in "biuf" or not np.isfinite(found).all():
        raise ValueError
    return found.astype(np.float64).reshape(shape)


def read_number(value: object) -> float:
    """A finite number in extras, as `read_numbers`."""
    return float(read_numbers(value))


def read_spring(data: Json) -> tuple[float, float]:
    """The frequency, in hertz, and the damping ratio of a spring in extras.

    Raises:
        ValueError: They are none of a spring that a bake writes.
    """
    frequency, damping = (read_number(data[key]) for key in ("frequency", "damping"))
    if not (0 < frequency < _MOST and 0 < damping < _MOST):
        raise ValueError
    return frequency, damping


def read_keys(data: Json, columns: int, name: str = "keys") -> dict[str, Floats]:
    """The keys of clips in extras, if there are any of a name: (keys, columns) times and what is there.

    Raises:
        ValueError: A clip has none, or their times do not rise.
    """
    keys = {clip: read_numbers(each, -1, columns) for clip, each in data.get(name, {}).items()}
    if any(not len(each) or not (np.diff(each[:, 0]) > 0).all() for each in keys.values()):
        raise ValueError
    return keys


def stored(values: Floats | float, digits: int = DIGITS) -> Any:
    """Numbers as extras hold them: rounded to significant decimal digits, arrays as lists."""
    if isinstance(values, np.ndarray) and values.ndim:
        return [stored(each, digits) for each in values]
    return significant(float(values), digits)


def strengths_json(strengths: Mapping[str, float], strength: float) -> Json:
    """The factors on weights in some clips, and in all others, as extras hold them: those that are not 1."""
    factors = {clip: stored(each) for clip, each in strengths.items()}
    return {
        **({"strengths": factors} if factors else {}),
        **({"strength": stored(strength)} if strength != 1.0 else {}),
    }


def read_strengths(data: Json) -> tuple[dict[str, float], float]:
    """The factors on weights in some clips, and in all others.

    Raises:
        ValueError: There are others than finite numbers.
    """
    strengths = {clip: read_number(factor) for clip, factor in data.get("strengths", {}).items()}
    return strengths, read_number(data.get("strength", 1.0))
