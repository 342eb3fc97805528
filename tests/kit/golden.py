"""Goldens of numbers and pictures: what the commands gave when somebody last looked at it.

`golden(found, "wrist.json")` compares numbers, `golden.text(found, "check.txt")` a text, and
`golden.picture(path, "grid.png")` a picture, with a file in tests/data/goldens. Where they differ the test fails.
`pytest --wrinkle-update` then replaces the golden, and the test still fails: a golden is never accepted unseen.
"""

import json
import re
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kit.places import ROOT, SHARED
from kit.player import Floats, Gltf, wrinkle_columns

FOLDER = ROOT / "tests" / "data" / "goldens"
TOLERANCE = 1e-3  # of a number, or of the greatest number in the same list: other processors round otherwise
_LEAST = 1e-7  # scene units that rounding to float32 leaves where the exact number is 0
_DIGITS = 6  # significant digits that a golden keeps
_MOST_NUMBERS = 24  # of a list that a golden keeps; of a longer one it keeps sums
_PLACES = re.compile(rf"({re.escape(str(ROOT))}|{re.escape(str(SHARED))})/\S*/")  # folders differ between runs
# Of a picture: a grey level that the eye sees, and the part of the pixels that may be further off, as fonts differ.
_LEVELS, _PIXELS = 24, 0.002
_MEAN = 0.02  # grey levels by which all pixels may be off
_NUMBER = re.compile(r"(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)")


class Golden:
    """Compares with goldens; `update` replaces those that differ."""

    def __init__(self, *, update: bool) -> None:
        self._update = update

    def __call__(self, found: Any, name: str, *, tolerance: float = TOLERANCE) -> None:
        """Compare JSON values with a golden; a number may be off by a part of the greatest in the same list."""
        path = FOLDER / name
        found = json.loads(json.dumps(_rounded(found)))
        kept = json.loads(path.read_text()) if path.exists() else None
        lines = list(differences(kept, found, "", tolerance))
        if lines and self._update:
            path.write_text(json.dumps(found) + "\n")
        if lines:
            pytest.fail("\n".join([f"{name}: golden, found", *lines[:20]]), pytrace=False)

    def text(self, found: str, name: str) -> None:
        """Compare a text with a golden; widths of columns may differ, and numbers by what rounding is."""
        path = FOLDER / name
        found = _PLACES.sub("", found).rstrip() + "\n"
        kept = path.read_text() if path.exists() else ""
        pairs = list(zip_longest(kept.splitlines(), found.splitlines(), fillvalue=""))
        lines = [
            f"{number}: {old}\n{number}: {new}" for number, (old, new) in enumerate(pairs) if not same_line(old, new)
        ]
        if lines and self._update:
            path.write_text(found)
        if lines:
            pytest.fail("\n".join([f"{name}: golden, found", *lines[:20]]), pytrace=False)

    def picture(self, found: Path, name: str, *, reduced: int = 1) -> None:
        """Compare a picture, made smaller by a whole number, with a golden."""
        path = FOLDER / name
        image = Image.open(found).convert("RGB").reduce(reduced)
        kept = Image.open(path).convert("RGB") if path.exists() else Image.new("RGB", (1, 1))
        off = (
            np.abs(np.subtract(image, kept, dtype=int)).max(axis=2) if image.size == kept.size else np.full((1, 1), 255)
        )
        if off.mean() > _MEAN or (off > _LEVELS).mean() > _PIXELS:
            if self._update:
                image.save(path, optimize=True)
            many = (off > _LEVELS).mean()
            message = (
                f"{found} differs from {path} by {off.mean():.2f} grey levels, in {many:.2%} of its pixels by more"
            )
            pytest.fail(f"{message} than {_LEVELS}", pytrace=False)


def differences(kept: Any, found: Any, place: str, tolerance: float, limit: float = 0.0) -> Iterator[str]:
    """A line for each difference of JSON values; a number may be off by a limit, or by a part of itself."""
    if isinstance(kept, dict) and isinstance(found, dict):
        for key in sorted(kept.keys() | found.keys()):
            yield from differences(kept.get(key), found.get(key), f"{place}/{key}", tolerance)
    elif isinstance(kept, list) and isinstance(found, list) and len(kept) == len(found):
        limit = tolerance * max((abs(each) for each in kept if _is_number(each)), default=0.0)
        for number, (a, b) in enumerate(zip(kept, found, strict=True)):
            yield from differences(a, b, f"{place}/{number}", tolerance, limit)
    elif _is_number(kept) and _is_number(found):
        if abs(kept - found) > max(limit, tolerance * abs(kept), 1e-9):
            yield f"{place}: {kept}, {found}"
    elif kept != found:
        yield f"{place}: {str(kept)[:200]}, {str(found)[:200]}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _rounded(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _rounded(value.tolist())
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in (summed(np.array(value)) if _is_long(value) else value)]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    return _PLACES.sub("", value) if isinstance(value, str) else value


def _is_long(values: Sequence[Any]) -> bool:
    """True for a long list of numbers, or of rows of numbers."""
    try:
        array = np.array(values)
    except ValueError:  # rows of different lengths
        return False
    return array.dtype.kind in "if" and array.size > _MOST_NUMBERS


def same_line(kept: str, found: str) -> bool:
    """True for the same words, and numbers that differ by less than a part of themselves or than their last digit."""
    (words, numbers), (own_words, own_numbers) = (
        (parts[::2], parts[1::2]) for parts in (_NUMBER.split(" ".join(line.split())) for line in (kept, found))
    )
    return words == own_words and all(
        abs(float(a) - float(b)) <= 1.01 * max(TOLERANCE * abs(float(a)), _last_digit(a), _last_digit(b), _LEAST)
        for a, b in zip(numbers, own_numbers, strict=True)
    )


def _last_digit(number: str) -> float:
    """The value of one in the last digit of a number; 0 for a whole number, which has not been rounded."""
    digits, _, power = number.partition("e")
    decimals = len(digits.partition(".")[2])
    return float(10.0 ** (int(power or 0) - decimals)) if decimals or power else 0.0


def summed(values: Floats) -> list[float]:
    """An array in a few numbers, which change with each of its elements and with their order."""
    flat = np.asarray(values, np.float64).ravel()
    numbers = np.arange(len(flat))
    waves = [np.cos(0.1 * numbers), np.cos(2.0 * numbers + 1.0), np.cos(np.sqrt(2.0) * numbers**1.5)]
    scale = np.sqrt(max(len(flat), 1))
    return [
        len(flat) / 1e4,
        *(float(each) / scale for each in (np.linalg.norm(flat), *(flat @ wave for wave in waves))),
    ]


def wrinkles_of(file: Gltf) -> dict[str, Any]:
    """The wrinkles of a bake: what they add to positions and normals at some moments, how shapes are stored, extras."""
    described = {}
    for number, node in enumerate(file.json["nodes"]):
        if "wrinkle" not in node.get("extras", {}):
            continue
        columns = wrinkle_columns(file, number)
        moments = {}
        for clip in file.json.get("animations", []):
            keys, _ = file.keys(clip["name"], number)
            times = np.linspace(keys[0], keys[-1], 8)[1:-1]
            with_, without = (file.pose(number, clip["name"], times, without=each) for each in ((), columns))
            turned, plain = (file.normals(number, clip["name"], times, without=each) for each in ((), columns))
            moments[clip["name"]] = [
                [summed(a - b), summed(c - d)] for a, b, c, d in zip(with_, without, turned, plain, strict=True)
            ]
        described[str(node.get("name", number))] = {
            "moments": moments,
            "shapes": [summed(each) for each in file.deltas(number)[columns]],
            "triangles": summed(file.triangles(number)),
            "extras": {key: value for key, value in node["extras"]["wrinkle"].items() if key != "original"},
        }
    return described
