"""Drives of fields: the turns of some joints, each with rows of weights for targets of its own."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kit.fields import TURNS, sleeve_with_turns
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.drive.drive import StoredDrive
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.gltf.document import read_document

TIMES = np.linspace(0.0, 2.0, 21)
FIELD: dict[str, Any] = {
    "name": "nan",
    "turns": TURNS,
    "strengths": {"inf": 0.5},
    "strength": 0.8,
    "targets": ["a", "b", "c", "d", "nan"],
}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(read_document(sleeve_with_turns().path), 0)


@pytest.fixture(scope="module")
def clips() -> list[Clip]:
    return read_clips(read_document(sleeve_with_turns().path))


def read(data: Any, rig: Rig) -> TurnDrive:
    found = StoredDrive.read(json.loads(json.dumps(data))).on({name: k for k, name in enumerate(rig.names)}, ())
    assert isinstance(found, TurnDrive)
    return found


def test_each_turn_has_rows_of_its_own(rig: Rig, clips: list[Clip]) -> None:
    """Angles of the sleeve's clips are known: 50° in both joints, which is 100° against what is above the first, and
    from 25° to -20° about another axis.
    """
    drive = read(FIELD, rig)
    fold, wave = clips
    angle = np.radians(50.0)
    first = [np.interp(angle, TURNS[0]["angles"], column) for column in np.transpose(TURNS[0]["weights"])]
    third = [np.interp(2.0 * angle, TURNS[2]["angles"], column) for column in np.transpose(TURNS[2]["weights"])]
    assert drive.weights_in(rig, fold)(np.ones(1))[0] == pytest.approx(0.8 * np.array([*first, 0.0, *third]), abs=1e-6)
    bent = drive.weights_in(rig, wave)(np.array([0.5, 1.0]))
    wanted = np.interp(np.radians([25.0, -20.0]), TURNS[1]["angles"], np.ravel(TURNS[1]["weights"]))
    assert bent[:, 2] == pytest.approx(0.8 * wanted, abs=1e-6)
    assert bent[:, :2] == pytest.approx(0.0, abs=1e-6)


def test_turns_raise_targets_together(rig: Rig, clips: list[Clip]) -> None:
    """Both turns are at 50° in the clip: squares add up, those of parts below 0 count against them, to 1 at most."""
    fold, _ = clips
    parts = [[0.6, 0.3, 0.9, 0.2], [0.5, -0.2, 0.8, -0.4]]
    turns = [
        {**TURNS[0], "angles": [0.0, 0.5], "weights": [[0.0] * 4, row], "raises": raises}
        for row, raises in zip(parts, ([0, 1, 2, 3], [3, 2, 1, 0]), strict=True)
    ]
    drive = read({"name": "n", "turns": turns, "targets": ["a", "b", "c", "d"]}, rig)
    wanted = np.sqrt([0.36 - 0.16, 0.09 + 0.64, 0.81 - 0.04, 0.04 + 0.25])
    assert drive.weights_in(rig, fold)(np.ones(1))[0] == pytest.approx(wanted, abs=1e-6)
    one = {**turns[0], "weights": [[0.0] * 4, [1.0, 2.0, -1.0, 0.0]]}
    most = read({"name": "n", "turns": [one, one], "targets": ["a", "b", "c", "d"]}, rig)
    assert most.weights_in(rig, fold)(np.ones(1))[0] == pytest.approx([1.0, 1.0, 0.0, 0.0], abs=1e-6)


@settings(max_examples=5)
@given(st.lists(st.lists(st.integers(0, 999), min_size=2, max_size=4), min_size=1, max_size=4), st.integers(0, 200))
def test_a_drive_is_read_as_it_was_written(columns: list[list[int]], percent: int) -> None:
    """Rows are any, and strengths go by clip."""
    path = sleeve_with_turns().path
    rig, (fold, wave) = read_rig(read_document(path), 0), read_clips(read_document(path))
    turns = [
        {
            **TURNS[k % 3],
            "angles": np.linspace(-1.0, 1.0, len(rows)).tolist(),
            "weights": [[x / 1000] for x in rows],
            "raises": [k],
        }
        for k, rows in enumerate(columns)
    ]
    data = {
        "name": "n",
        "turns": turns,
        "strengths": {"fold": percent / 100},
        "targets": [str(k) for k in range(len(turns))],
    }
    drive = read(data, rig)
    again = read(drive.to_json(rig.names, ()), rig)
    assert again.to_json(rig.names, ()) == drive.to_json(rig.names, ())
    for clip in (fold, wave):
        assert again.weights_in(rig, clip)(TIMES) == pytest.approx(drive.weights_in(rig, clip)(TIMES), abs=1e-6)
    whole = read({**data, "strengths": {}}, rig).weights_in(rig, fold)(TIMES)
    assert drive.weights_in(rig, fold)(TIMES) == pytest.approx(percent / 100 * whole)


def test_it_needs_its_joints_and_their_parents_once_each(rig: Rig) -> None:
    stored = StoredDrive.read(FIELD)
    assert sorted(stored.joints) == ["joint_0", "joint_1", "joint_2"]
    assert not stored.measures_segment
    assert stored.acts_alone
    assert stored.carrying_targets == frozenset()
    assert {rig.names[node] for node in read(FIELD, rig).nodes} == {"joint_0", "joint_1", "joint_2"}
    with pytest.raises(KeyError):
        stored.on({"joint_1": 2}, ())


def changed(**keys: Any) -> Any:
    """The field with other keys of its first turn."""
    return {**FIELD, "turns": [{**TURNS[0], **keys}, *TURNS[1:]]}


@pytest.mark.parametrize(
    "forged",
    [
        {**FIELD, "turns": []},
        {**FIELD, "turns": "joint_1"},
        {**FIELD, "targets": ["a", "b", "c", "d"]},
        changed(raises=[0, 5]),
        changed(raises=[0, 0]),
        changed(raises=[0]),
        changed(raises=["a", 0]),
        changed(weights=[[0.0], [0.1], [0.6], [1.0]]),
        changed(weights=[[0.0, 0.0], [0.1, 0.9], [0.6, 0.7]]),
        changed(weights=[[0.0, 0.0], [0.1, 0.9], [0.6], [1.0, 0.0]]),
        changed(weights=[]),
        changed(weights=[[], [], [], []]),
        changed(angles=[]),
        changed(angles=[0.0, 0.5, 0.2, 0.8]),
        changed(angles=[0.0, 0.2, 0.2, 0.8]),
        changed(rest=[0.0, 0.0, 0.0, 0.0]),
        changed(rest=[0.0, 0.0, 1.0]),
        changed(axis=[0.0, 1.0]),
        changed(joint="elsewhere"),
        changed(paths=[{"turns": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], "weights": TURNS[0]["weights"][:2]}]),
        changed(gains=[0.0, 0.1, 0.2, 0.3]),
        changed(angles=None, shortenings=[0.0, 0.2, 0.5, 0.8]),
        {**FIELD, "turns": [{key: value for key, value in TURNS[0].items() if key != "angles"}]},
    ],
    ids=str,
)
def test_what_no_bake_writes_is_refused(forged: Any, rig: Rig) -> None:
    read(FIELD, rig)
    with pytest.raises((KeyError, IndexError, TypeError, ValueError)):
        read(forged, rig)


def test_targets_that_move_nothing_take_their_weights_along(rig: Rig, clips: list[Clip]) -> None:
    drive = read(FIELD, rig)
    kept = np.array([True, False, False, True, True])
    found = drive.of_targets(kept)
    assert [signal.node for signal, _ in found.turns] == [drive.turns[0][0].node, drive.turns[2][0].node]
    wanted = drive.weights_in(rig, clips[0])(TIMES)[:, kept]
    assert np.array_equal(found.weights_in(rig, clips[0])(TIMES), wanted)
    assert found.targets == ("a", "d", "nan")
    assert np.array_equal(drive.of_targets(np.ones(5, np.bool_)).turns[1][1].table, drive.turns[1][1].table)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: {**data, "strengths": {"fold": 0.0}}, "its strength is 0 in this clip"),
        (
            lambda data: {**data, "turns": [{**TURNS[1], "raises": [0]}], "targets": ["a"]},
            "none of its joints turns far enough",
        ),
    ],
)
def test_it_says_why_it_stays_flat(change: Callable[[Any], Any], words: str, rig: Rig, clips: list[Clip]) -> None:
    drive = read(change(FIELD), rig)
    assert not drive.weights_in(rig, clips[0])(TIMES).any()
    assert words in drive.why_flat(rig, clips[0], TIMES)
