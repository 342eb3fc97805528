"""Drives in extras: a drive that is written and read again gives the same weights, for all signals and responses."""

import json
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, reduce
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kit.fields import TURNS as FIELD_TURNS
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.choices import EFFECTS
from wrinklecli.drive.angle import Angles, JointAngle
from wrinklecli.drive.drive import Drive, StoredDrive, stored_drives
from wrinklecli.drive.segment import Segment
from wrinklecli.drive.table import Path, Table
from wrinklecli.numeric.arrays import Floats

TIMES = np.linspace(0.0, 2.0, 41)
PATH = {"origin": None, "target": None, "path": [[-0.4, RADIUS, 0.0], [0.0, RADIUS, 0.0], [0.4, RADIUS, 0.0]]}


POINT = {"joints": ["nan"], "weights": [1.0], "positions": [[0.0, 0.0, 0.0]], "scales": [1.0]}


SIGNALS: Sequence[Mapping[str, Any]] = (
    {},
    PATH,
    {"lag": {"frequency": 4, "damping": 0.3}},
    {"rest_length": {"keys": {"fold": [[0, "90%"], [1.5, "130%"]]}}},
    {"rest_length": {"morph": "morph_1", "full": "140%"}},
    {**PATH, "lag": {"frequency": 6, "damping": 1}},
)


@cache
def limb(signal: int) -> Prepared:
    """The limb with morph targets that move its anchors, and a tool with one of `SIGNALS`."""
    keys = {key: value for key, value in tool(**SIGNALS[signal]).items() if value is not None}
    return prepare(limb_asset(rings=9, sides=8, morphs=2, morph_clip="LINEAR", weights_at="node"), keys)


def read_again(drive: Drive, prepared: Prepared) -> Drive:
    """The drive that the JSON of a drive gives, on the same rig."""
    rig = prepared.rig
    stored = StoredDrive.read(json.loads(json.dumps(drive.to_json(rig.names, rig.morph_names))))
    assert stored.targets == drive.targets
    assert set(stored.joints) <= set(rig.names)
    assert stored.measures_segment != isinstance(drive.signal, JointAngle)
    return stored.on({name: number for number, name in enumerate(rig.names)}, rig.morph_names)


def assert_same_weights(drive: Drive, prepared: Prepared) -> Floats:
    """Compare a drive with what is read again; the weights."""
    again = read_again(drive, prepared)
    assert (again.own, dict(again.strengths), again.lag) == (drive.own, dict(drive.strengths), drive.lag)
    assert again.strength == drive.strength
    wanted = drive.weights_in(prepared.rig, prepared.clip)(TIMES)
    assert again.weights_in(prepared.rig, prepared.clip)(TIMES) == pytest.approx(wanted, abs=1e-6)
    return wanted


# Weights that a table stores exactly: five digits.
WEIGHTS = st.lists(st.tuples(*[st.integers(-999, 999)] * 2), min_size=2, max_size=5)


@pytest.mark.quick(1)
@pytest.mark.parametrize("signal", range(len(SIGNALS)))
@settings(max_examples=3)
@given(WEIGHTS, st.integers(-200, 200).map(lambda each: each / 100.0), st.sampled_from(["fold", "another"]))
def test_a_table_by_shortening_is_read_as_it_was_written(signal: int, rows: Any, strength: float, clip: str) -> None:
    prepared = limb(signal)
    table = Table("shortenings", np.linspace(-0.5, 0.9, len(rows)), np.array(rows) / 1000.0)
    patch = prepared.patch
    drive = Drive(
        *("crease", patch.segment, ("a", "b"), table),
        lag=patch.tool.lag,
        strengths={clip: strength},
        strength=strength / 2.0,
    )
    weights = assert_same_weights(drive, prepared)
    factor = strength if clip == prepared.clip.name else strength / 2.0
    assert weights == pytest.approx(
        factor * replace(drive, strengths={}, strength=1.0).weights_in(prepared.rig, prepared.clip)(TIMES)
    )
    assert weights.shape == (len(TIMES), 2)


@pytest.mark.parametrize("signal", [3, 4])
def test_weights_grow_with_the_rest_length(signal: int) -> None:
    prepared = limb(signal)
    rig, clip = prepared.rig, prepared.clip
    table = Table("shortenings", np.array([0.0, 0.9]), np.array([[0.1], [1.0]]))
    drive = Drive("crease", prepared.patch.segment, ("a",), table)
    lengths = prepared.patch.segment.lengths(rig, clip, TIMES)
    rows = np.interp(lengths.rows, table.rows, table.table[:, 0])
    factors = prepared.patch.segment.rest_length.at(rig, clip, TIMES) / prepared.patch.segment.rest_length.constant
    assert np.ptp(factors) > 0.1
    assert drive.weights_in(rig, clip)(TIMES)[:, 0] == pytest.approx(factors * rows)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).filter(lambda each: np.linalg.norm(each) > 0.1), WEIGHTS)
def test_a_joint_s_angle_is_read_as_it_was_written(axis: list[float], rows: Any) -> None:
    prepared = limb(0)
    node = prepared.rig.names.index("joint_1")
    signal = JointAngle(
        node, int(prepared.rig.parents[node]), np.array(axis) / np.linalg.norm(axis), np.array([0.0, 0.0, 0.0, 1.0])
    )
    table = Table("angles", np.linspace(-2.0, 2.0, len(rows)), np.array(rows) / 1000.0)
    assert_same_weights(Drive("", signal, ("a", "b"), table, own=("c",)), prepared)


@pytest.mark.parametrize(
    "broken",
    [
        {"rest_length": 0.0},
        {"shortenings": [0.1, 0.1]},
        {"weights": [[1.0]]},
        {"gains": [0.0]},
        {"gains": [0.0, 1.0], "lows": [-1.0]},
        {"gains": [0.0, 1.0], "joint": "joint_1", "rest": [0.0, 0.0, 0.0, 1.0], "axis": [1.0, 0.0, 0.0]},
        {"lag": {"frequency": 0.0, "damping": 1.0, "taut": 1.0}},
        {"rest_length_keys": {"fold": [[1.0, 1.0], [0.0, 1.0]]}},
        {"origin": {"joints": ["joint_0"], "weights": [1.0], "positions": [[0.0, 0.0, 0.0]], "scales": [0.0]}},
    ],
)
def test_extras_that_no_bake_writes_are_refused(broken: dict[str, Any]) -> None:
    prepared = limb(0)
    table = Table("shortenings", np.array([0.0, 0.5]), np.array([[0.0], [1.0]]))
    data = Drive("crease", prepared.patch.segment, ("a",), table).to_json(prepared.rig.names, prepared.rig.morph_names)
    StoredDrive.read(data)
    with pytest.raises(ValueError):  # noqa: PT011  # it has no words: who reads extras says where they are
        StoredDrive.read({**data, **broken})


SEGMENT = {
    "name": "nan",
    "origin": POINT,
    "target": {**POINT, "morphs": {"inf": [[0.1, 0.0, 0.0]]}},
    "rest_length": 1.0,
}
ROWS = {"shortenings": [0.0, 0.5], "weights": [[0.0], [1.0]], "targets": ["nan"]}
KEYED = {"nan": [[0.0, 0.5], [1.0, 0.6]]}
JOINT = {"joint": "nan", "parent": "inf", "rest": [0.0, 0.0, 0.0, 1.0], "axis": [1.0, 0.0, 0.0]}
TURNS = {
    "angles": [0.0, 1.0],
    "weights": [[0.0], [1.0]],
    "paths": [{"turns": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], "weights": [[0.0], [1.0]]}],
    "targets": ["nan"],
}
BOTH = {
    **{key: value for key, value in TURNS.items() if key != "paths"},
    "other": {"joint": "inf", "parent": "nan", "rest": [0.0, 0.0, 0.0, 1.0]},
    "paths_with_other": [{"turns": [[0.0] * 6, [0.1] * 6], "weights": [[0.0], [1.0]]}],
}
SPRING = {"frequency": 4.0, "damping": 0.5}
MODE = {**SPRING, "load": [1.0, 0.0, 0.0], "gain": 1.0}
TOUCH = {
    "name": "nan",
    "anchors": [POINT] * 4,
    "pad": 1.0,
    "grip": 1.0,
    "deepest": 1.0,
    "bend": [0.0, 0.0, 0.0],
    "windows": [0.0],
    "turn": 0.1,
    "by": POINT,
    "limb": [POINT] * 2,
    "release": SPRING,
    "rises": [[0.0, 0.0], [1.0, 1.0]],
    "keys": {"nan": [[0.0] * 4]},
    "ends": {"nan": [1.0]},
    "targets": ["nan"] * 14,
}
KINDS: Mapping[str, Mapping[str, Any]] = {
    "shortening": {**SEGMENT, **ROWS, "strengths": {"nan": 0.5}, "strength": 0.5, "lag": SPRING},
    "keyed": {**SEGMENT, **ROWS, "rest_length_keys": KEYED},
    "morph": {**SEGMENT, **ROWS, "rest_length_morph": {"name": "nan", "full": 1.2}},
    "activation": {**SEGMENT, **ROWS, "gains": [0.0, 1.0], "tension": {"length": 0.1, "morph": "nan"}},
    "keyed activation": {**SEGMENT, **ROWS, "lows": [0.0], "tension": {"length": 0.1, "keys": KEYED}},
    "turn": {**JOINT, **TURNS},
    "two turns": {**JOINT, **BOTH},
    "field": {
        "name": "nan",
        "turns": FIELD_TURNS,
        "strengths": {"inf": 0.5},
        "strength": 0.8,
        "targets": ["a", "b", "c", "d", "nan"],
    },
    "flesh": {
        "name": "nan",
        "joint": "nan",
        "at": [0.0, 0.0, 0.0],
        "scale": 1.0,
        "gravity": [0.0, -9.8, 0.0],
        "modes": [MODE],
        "targets": ["nan", "inf"],
    },
    "touch": TOUCH,
}


def number_places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The keys and indices that lead to each number in a JSON value."""
    if isinstance(value, float | int):
        yield place
    elif isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from number_places(each, (*place, key))


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_that_are_not_finite_are_refused_wherever_they_stand(kind: str) -> None:
    """Names such as `nan` are names."""
    text = json.dumps(KINDS[kind])
    StoredDrive.read(json.loads(text))
    for *way, last in number_places(json.loads(text)):
        for forged in ("nan", "inf", float("-inf")):
            data = json.loads(text)
            reduce(operator.getitem, way, data)[last] = forged
            with pytest.raises(ValueError):  # noqa: PT011
                StoredDrive.read(data)


def test_a_rest_length_is_constant_on_a_rig_without_its_morph_target() -> None:
    prepared = limb(4)
    table = Table("shortenings", np.array([0.0, 0.9]), np.array([[0.0], [1.0]]))
    drive = Drive("crease", prepared.patch.segment, ("wrinkle_crease_1",), table)
    stored = StoredDrive.read(json.loads(json.dumps(drive.to_json(prepared.rig.names, prepared.rig.morph_names))))
    found = stored.on({name: number for number, name in enumerate(prepared.rig.names)}, ["morph_0"])
    assert prepared.patch.segment.rest_length.morph is not None
    assert isinstance(found.signal, Segment)
    assert found.signal.rest_length.morph is None


def test_weights_are_those_of_a_clip_at_its_turns_and_those_of_the_table_10_degrees_away() -> None:
    rows = np.array([-1.5, 1.5])
    turns = np.array([[0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [0.5, 0.0, 0.1]])
    path = Path(turns, np.array([[0.0, 0.0], [0.4, 0.1], [0.2, 0.9]]))
    table = Table("angles", rows, np.full((2, 2), 0.7), paths=(path,))

    def at(turned: Floats) -> Floats:
        return table.weights(Angles(np.zeros(len(turned)), turned))

    assert at(turns) == pytest.approx(path.weights, abs=1e-6)
    assert at((turns[:-1] + turns[1:]) / 2) == pytest.approx((path.weights[:-1] + path.weights[1:]) / 2, abs=1e-6)
    assert at(turns + np.array([0.0, 0.0, 0.3])) == pytest.approx(np.full((3, 2), 0.7))
    # There is no jump on the way out.
    away = turns[1] + np.linspace(0.0, 0.2, 20_001)[:, None] * [0.0, 0.0, 1.0]
    assert np.abs(np.diff(at(away), axis=0)).max() < 1e-3


def test_weights_along_the_turns_of_two_joints_differ_where_one_of_them_is_turned_otherwise() -> None:
    """A joint that stands still may have another behind it that folds its surface."""
    data = json.loads(json.dumps({**JOINT, **BOTH}))
    drive = StoredDrive.read(data).on({"nan": 1, "inf": 0}, ())
    assert isinstance(drive.signal, JointAngle)
    assert drive.nodes == {0, 1}
    assert isinstance(drive.response, Table)
    turns = np.array([[0.1] * 6, [*[0.1] * 3, *[0.0] * 3]])
    found = drive.response.weights(Angles(np.zeros(2), turns))
    assert found[0] == pytest.approx([1.0], abs=1e-6)
    assert found[1] == pytest.approx([0.0], abs=1e-6)
    with pytest.raises(ValueError):  # noqa: PT011
        StoredDrive.read({**data, "paths_with_other": TURNS["paths"]})


def test_a_table_of_turns_with_rows_of_clips_is_read_as_it_was_written() -> None:
    prepared = limb(0)
    rows = np.array([[0.0, 0.5], [0.2, 0.1], [1.0, 0.0]])
    path = Path(np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 0.0], [0.3, 0.2, 0.0]]), rows)
    table = Table("angles", np.array([-1.5, 0.0, 1.5]), rows, paths=(path,))
    joint = prepared.rig.names.index("joint_1")
    signal = JointAngle(joint, int(prepared.rig.parents[joint]), np.array([0.0, 0.6, 0.8]), np.array([0.0, 0, 0, 1.0]))
    drive = Drive("", signal, ("a", "b"), table)
    assert assert_same_weights(drive, prepared).any()
    data = drive.to_json(prepared.rig.names, prepared.rig.morph_names)
    for absent in ([{"turns": [[0.0, 0.0, 0.0]], "weights": [[0.0, 0.0]]}], [{"turns": [[0.0, 0.0, 0.0]] * 2}]):
        with pytest.raises((KeyError, ValueError)):
            StoredDrive.read({**data, "paths": absent})
    # Keys of older files are ignored.
    older = {"leaning": [{"towards": [0.0, 5.0, 0.0], "weights": rows.tolist()}], "null": [0.5, 1.0]}
    found = StoredDrive.read({**data, **older}).on({"joint_0": 1, "joint_1": 2}, ()).response
    assert isinstance(found, Table)
    assert found.table == pytest.approx(rows)


@given(st.permutations([*EFFECTS]), st.integers(0, len(EFFECTS)))
def test_stored_drives_act_in_the_order_of_their_kinds(sections: list[str], count: int) -> None:
    """A file may list them in any order. A bake always writes tools, so extras without them are of others."""
    entry = {section: [{"name": section}] for section in sections[:count]}
    if "tools" in entry:
        assert [each["name"] for each in stored_drives(entry)] == [each for each in EFFECTS if each in entry]
    else:
        with pytest.raises(KeyError):
            stored_drives(entry)
