"""The drive of a touch in extras."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.bakes import place
from kit.touch import GRIP, PAD, SECONDS, plate
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.drive.drive import StoredDrive
from wrinklecli.drive.touch import TouchDrive, weights_of
from wrinklecli.gltf.document import read_document

ANCHOR = {"joints": ["hand"], "weights": [1.0], "positions": [[0.0, 0.0, 0.0]], "scales": [1.0]}
PALM = {
    "name": "palm",
    "anchors": [ANCHOR] * 4,
    "pad": 1.0,
    "grip": 1.0,
    "deepest": 1.0,
    "bend": [0.0, 0.0, 0.0],
    "release": {"frequency": 4.0, "damping": 1.0},
    "rises": [[0.0, 0.0], [1.0, 1.0]],
}

# Where the axes of a place of the plate end.
ENDS = np.array([[0.0, 0.0, 0.0], [PAD, 0.0, 0.0], [0.0, 0.0, PAD], [0.0, PAD, 0.0]])


@given(st.lists(st.floats(-3.0, 3.0), max_size=4), st.booleans(), st.integers(-9, 9))
def test_a_touch_has_a_target_for_each_of_its_shapes(windows: list[float], limb: bool, more: int) -> None:
    """Four slides and a dent, one for each window, and eight that a limb's bend changes."""
    count = 5 + len(windows) + 8 * limb
    targets = [f"wrinkle_palm_{k}" for k in range(count + more)]
    data: dict[str, Any] = {**PALM, "windows": windows, "targets": targets} | ({"limb": [ANCHOR] * 2} if limb else {})
    if more == 0:
        assert len(StoredDrive.read(data).targets) == count
    else:
        with pytest.raises(ValueError):  # noqa: PT011  # it has no words: who reads extras says where they are
            StoredDrive.read(data)


def full_palm(**other: Any) -> dict[str, Any]:
    """A drive with all that a touch may have."""
    return {
        **PALM,
        "windows": [0.0, 2.0, -2.0],
        "limb": [ANCHOR] * 2,
        "by": ANCHOR,
        "turn": 0.3,
        "rises": [[0.0, 0.0], [0.5, 1.0], [0.9, 0.2]],
        "keys": {"once": [[0.5, 0.1, 0.2, 0.3]], "twice": [[-0.5, 0.4, 0.3, 0.2], [0.1, 0.1, 0.2, 0.3]]},
        "ends": {"once": [0.8], "twice": [0.2, 0.1]},
        "targets": [f"wrinkle_palm_{k}" for k in range(16)],
    } | other


def test_a_stored_touch_is_read_as_it_was() -> None:
    drive = StoredDrive.read(full_palm()).on({"hand": 0}, ())
    written = drive.to_json(["hand"], ())
    assert written == full_palm()


@given(st.floats(-3.0, 3.0), st.floats(1.0, 9.0))
def test_a_tip_slips_beyond_its_grip(angle: float, farther: float) -> None:
    """The skin slides no farther, so all weights stay as they are at the grip."""
    slides = np.outer([1.0, farther], [np.cos(angle), np.sin(angle)])
    windows, rises = np.array([0.0, 2.0]), np.array([[0.0, 0.0], [0.5, 0.2], [1.0, 1.0]])
    at_grip, beyond = weights_of(slides, np.full(2, 0.5), windows, rises, 0.3, np.full(2, 0.4))
    assert beyond == pytest.approx(at_grip, abs=1e-9)


@pytest.mark.parametrize("count", [1, 2, 8])
def test_places_of_a_row_share_a_contact(count: int) -> None:
    """The shares of two neighbours sum to one, and their mean place is the contact's, as far as the row goes."""
    row = {key: PALM[key] for key in ("anchors", "bend", "rises")} | {"windows": [0.0]}
    data = PALM | row | {"targets": [f"wrinkle_palm_{k}" for k in range(5 + 1 if count == 1 else 3 * count)]}
    data |= {"row": [row] * (count - 1), "spacing": 0.25} if count > 1 else {}
    drive = StoredDrive.read(data).on({"hand": 0}, ())
    assert drive.to_json(["hand"], ()) == data
    along = np.linspace(-0.5, 3.0, 71)
    shares = drive.shares(along)
    assert shares.sum(axis=0) == pytest.approx(1.0)
    assert (np.abs(np.diff(shares > 0, axis=0).astype(int)).sum(axis=0) <= 2).all()
    assert ((shares > 0).sum(axis=0) <= 2).all()
    assert 0.25 * np.arange(count) @ shares == pytest.approx(np.clip(along, 0.0, 0.25 * (count - 1)))


@pytest.mark.parametrize(
    "forged",
    [
        *({key: value} for key in ("pad", "grip", "deepest") for value in (0.0, -1.0, np.nan, np.inf)),
        *({"release": {"frequency": 4.0, "damping": 1.0, key: value}}
          for key in ("frequency", "damping") for value in (0.0, -1.0, 1e4, np.nan)),
        *({"keys": {"a": [[0.0] * 4], "b": keys}}
          for keys in ([], [[0.0] * 4] * 2, [[0.5, 0, 0, 0], [0.0, 1, 1, 1]],
                       [[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 1, 1]], [[0.0, np.nan, 0.0, 0.0]])),
        {"ends": {"a": [0.5], "b": [0.5, np.inf]}},
        {"windows": [0.0, np.nan, 1.0]},
        {"bend": [0.0, 0.0, np.inf]},
        {"turn": np.nan},
        *({"rises": rises} for rises in ([], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [-0.5, 1.0]], [[0.0, np.nan]],
                                         [[0.0, 0.0], [1.0, 0.5], [1.0, 1.0]])),
        *({"limb": [ANCHOR] * count} for count in (1, 3)),
        *({"anchors": [ANCHOR] * count} for count in (3, 5)),
        {"spacing": 1.0},
        {"row": [{key: PALM[key] for key in ("anchors", "bend", "rises")} | {"windows": []}]},
    ],
    ids=str,
)  # fmt: skip
def test_a_forged_touch_is_refused(forged: dict[str, Any]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  # it has no words: who reads extras says where they are
        StoredDrive.read(full_palm(**forged))


def rests_on(**other: Any) -> dict[str, Any]:
    """A drive on the plate of `kit.touch`, whose node `tip` touches it."""
    anchors = [{**ANCHOR, "joints": ["bone"], "positions": [end]} for end in ENDS.tolist()]
    sizes = {"pad": PAD, "grip": GRIP, "deepest": 0.003}
    shown = {"anchors": anchors, "by": {**ANCHOR, "joints": ["tip"]}, "windows": []}
    return PALM | sizes | shown | {"targets": [f"wrinkle_palm_{k}" for k in range(5)]} | other


@given(st.lists(st.tuples(*[st.floats(-0.03, 0.08)] * 3), min_size=2, max_size=4, unique=True))
def test_a_tip_over_a_row_is_above_the_skin_by_what_each_place_near_it_bends(ways: list[tuple[float, ...]]) -> None:
    """Forward is +x, up is +y and sideways +z; three places, a pad apart, share a tip between them."""
    document = read_document(place(plate(cells=2, tip=np.array(ways), turns=False)))
    bends, moved = np.array([[3.0, 0.5, -2.0], [-4.0, 1.0, 7.0], [6.0, -2.0, 1.0]]), np.array([[PAD, 0.0, 0.0]])
    rows = [
        {"anchors": [{**ANCHOR, "joints": ["bone"], "positions": [end]} for end in (ENDS + k * moved).tolist()],
         "bend": bend.tolist(), "rises": PALM["rises"], "windows": []}
        for k, bend in enumerate(bends)
    ]  # fmt: skip
    data = rests_on(row=rows[1:], spacing=PAD, targets=[f"wrinkle_palm_{k}" for k in range(6)], **rows[0])
    drive = StoredDrive.read(data).on({"bone": 1, "tip": 2}, ())
    assert isinstance(drive, TouchDrive)
    times = np.linspace(0.0, SECONDS, len(ways))
    found = drive.tip_in(read_rig(document, 0), read_clips(document)[0], times)
    x, y, z = np.array(ways, np.float32).astype(float).T
    heights = [y - bend @ [(x - k * PAD) ** 2, (x - k * PAD) * z, z**2] for k, bend in enumerate(bends)]
    numbers = np.clip(x / PAD, 0.0, 2.0)
    mean = [
        np.interp(number, [0.0, 1.0, 2.0], each) for number, each in zip(numbers, np.transpose(heights), strict=True)
    ]
    assert found == pytest.approx(np.stack([x, z, mean], axis=1), abs=1e-6)  # keys are float32


@pytest.mark.parametrize("lifted", [0.5, 2.0])
def test_a_tip_that_is_on_the_skin_when_a_clip_begins_has_not_slid_it_yet(tmp_path: Path, lifted: float) -> None:
    """It drags the skin as far as it goes, and lets go where it is lifted, if it is within the clip."""
    ways = np.array([(-0.004, 0.0, 0.0), (0.0, 0.0, 0.001), (0.004, 0.0, 0.002), (0.004, 0.0, 0.002)])
    ways[np.linspace(0.0, SECONDS, len(ways)) > lifted, 1] = 1.0
    document = read_document(plate(cells=2, tip=ways, turns=False).write(tmp_path / "plate.glb"))
    drive = StoredDrive.read(rests_on()).on({"bone": 1, "tip": 2}, ())
    assert isinstance(drive, TouchDrive)
    rig, (clip,) = read_rig(document, 0), read_clips(document)
    (stroke,) = drive.strokes_in(rig, clip)
    assert stroke[0, :3] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    ended = drive.ends_in(rig, [clip])["drag"]
    assert ended == pytest.approx([stroke[-1, 0]])
    if lifted < SECONDS:
        assert ended[0] < lifted + SECONDS / 3
    else:
        assert stroke[-1, :3] == pytest.approx([SECONDS, 0.008, 0.002], abs=1e-6)


@pytest.mark.parametrize(
    "ways",
    [
        [(-0.005, 0, -0.001), (0.009, 0, -0.001), (0, 0.009, -0.001), (-0.009, 0, -0.001), (-0.005, 0, -0.001)],
        [(-0.005, 0, 0.03), (-0.005, 0, -0.001), *[(0.002 * k, 0, -0.001) for k in range(6)], (-0.005, 0, 0.03)],
    ],
    ids=["held", "let go"],
)
def test_a_loop_ends_as_it_begins(ways: list[tuple[float, float, float]]) -> None:
    """A tip that rubs the skin slips, and one that lets go late leaves the skin slid where the clip begins anew."""
    tip = np.array(ways)[:, [0, 2, 1]]
    document = read_document(place(plate(cells=2, tip=tip, turns=False)))
    data = rests_on(release={"frequency": 1.0, "damping": 0.7})
    drive, (clip,) = StoredDrive.read(data).on({"bone": 1, "tip": 2}, ()), read_clips(document)
    assert isinstance(drive, TouchDrive)
    start, end = drive.contacts_in(read_rig(document, 0), clip)(np.array([0.0, SECONDS]))
    assert np.hypot(*start[:2]) > 0.1 * GRIP
    assert start[:2] == pytest.approx(end[:2], abs=0.002 * GRIP)
    assert (start[2] > 0) == (ways[0][2] < 0)
    # It comes and goes 3 mm above the skin, on straight ways.
    stroke = drive.strokes_in(read_rig(document, 0), clip)[-1]
    low, high = SECONDS / 8 * 27 / 31, SECONDS - SECONDS / 8 * 27 / 31
    assert stroke[[0, -1], 0] == pytest.approx([0.0, SECONDS] if ways[0][2] < 0 else [low, high], abs=1e-5)
