"""Searches by boxes find everything that is near, and leave out most of what is not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.numeric import boxes
from wrinklecli.numeric.boxes import Boxes, Cells
from wrinklecli.numeric.nearest import Blocks, closest_point


@pytest.mark.parametrize("count", [1, 2, 31, 700])
@pytest.mark.parametrize("flat", [0, 1, 3])
def test_every_point_of_a_ball_is_in_a_cell_that_it_reaches(count: int, flat: int) -> None:
    random = np.random.default_rng(count + flat)
    points, middles = random.normal(size=(count, 3)), random.normal(size=(40, 3))
    points[:, :flat] = 0.25
    radii = random.uniform(0.0, 1.5, 40)
    cells = Cells.of(points)
    assert sorted(cells.numbers_in(np.arange(len(cells.starts))).tolist()) == list(range(count))
    balls, reached = cells.meeting(middles, radii)
    found = set(zip(np.repeat(balls, cells.counts[reached]).tolist(), cells.numbers_in(reached).tolist(), strict=True))
    near = np.argwhere(np.linalg.norm(points - middles[:, None], axis=2) <= radii[:, None])
    assert {(ball, point) for ball, point in near.tolist()} <= found
    if count > 600 and not flat:
        assert len(found) < 0.5 * 40 * count, "most pairs are not looked at"


@given(seed=st.integers(0, 9999), apart=st.sampled_from([0.0, 1e3, 1e9]), size=st.integers(1, 9))
def test_blocks_that_are_too_far_need_not_be_looked_at(seed: int, apart: float, size: int) -> None:
    rng = np.random.default_rng(seed)
    # Of few numbers, so that many triangles are equally near; vertex 0 has none.
    positions = rng.integers(-3, 4, (20, 3)) * rng.choice([0.1, 1.0]) + apart * rng.normal(size=3)
    triangles = rng.integers(1, 20, (30, 3))[rng.integers(0, 30, 50)]
    point = positions[0] + rng.choice([0.0, 0.05, 1.0]) * rng.integers(-1, 2, 3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boxes, "_LEAST_THINGS", 0)
        patch.setattr(boxes, "_BOX_SIZE", size)
        found = Blocks.of(positions, triangles).closest_point(point)
    for each, wanted in zip(found, closest_point(positions, triangles, point), strict=True):
        assert np.array_equal(each, wanted)


@given(seed=st.integers(0, 9999), many=st.booleans())
def test_things_that_reach_between_bounds_are_found_and_few_others(seed: int, many: bool) -> None:
    rng = np.random.default_rng(seed)
    places = np.cumsum(rng.normal(size=(300, 3)), axis=0) * 10.0 ** rng.integers(-3, 9)
    origin, directions = places[7], rng.normal(size=(2, 3)) / np.ptp(places)
    low, high = np.sort(rng.normal(size=(2, 2)) / 4.0, axis=0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boxes, "_LEAST_THINGS", 0 if many else 1000)
        patch.setattr(boxes, "_BOX_SIZE", 8)
        found = Boxes.of(places, places).reaching(origin, directions, low, high)
    along = (places - origin) @ directions.T
    assert set(np.flatnonzero(((along >= low) & (along <= high)).all(axis=1))) <= set(found.tolist())
    assert (np.diff(found) > 0).all()
    if not many:
        assert len(found) in (0, 300)


def test_of_many_triangles_few_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    things = Boxes.things

    def counting(self: Boxes, chosen: np.ndarray) -> np.ndarray:
        found = things(self, chosen)
        seen.append(len(found))
        return found

    monkeypatch.setattr(Boxes, "things", counting)
    steps = np.arange(5000.0)
    positions = np.stack([steps, steps % 2, 0.0 * steps], axis=1)
    triangles = np.arange(4998)[:, None] + np.arange(3)
    Blocks.of(positions, triangles).closest_point(np.array([2500.0, 0.3, 1.0]))
    assert seen
    assert max(seen) <= 128
