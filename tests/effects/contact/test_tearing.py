"""Tears: edges that contact lengthens, and triangles that it turns over; wrinkles and skinning are none."""

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bent_tube import bent, tube
from wrinklecli.effects.contact.tearing import Tearing


@pytest.fixture(scope="module")
def surface() -> tuple[np.ndarray, Tearing]:
    rest, triangles = tube(60.0)
    return rest, Tearing.of(rest, triangles, np.abs(rest[:, 0]) < 100.0, np.zeros(len(rest), bool))


def nothing(positions: np.ndarray) -> np.ndarray:
    """No vertex crosses anything."""
    return np.zeros(len(positions), bool)


def test_what_skinning_and_wrinkling_do_is_no_tear(surface: tuple[np.ndarray, Tearing]) -> None:
    rest, tearing = surface
    assert not tearing.tears(rest, rest, nothing)
    for angle in np.radians([30.0, 90.0, 150.0]):
        posed = bent(rest, angle, 50.0, 20.0).positions
        assert not tearing.tears(posed, posed, nothing)
        assert not tearing.tears(3.0 * posed, 3.0 * posed, nothing)
    # Contact gives edges back what skinning has taken, and turns over what skinning has turned over.
    assert not tearing.tears(rest * [1.0, 0.0, 0.0], rest, nothing)
    assert not tearing.tears(rest * [1.0, 1.0, -0.1], rest, nothing)


def test_an_edge_of_twice_its_length_is_a_tear(surface: tuple[np.ndarray, Tearing]) -> None:
    rest, tearing = surface
    near, far = tearing.edges[len(tearing.edges) // 2]
    along = (rest[near] - rest[far]) * (np.arange(len(rest)) == near)[:, None]
    assert not tearing.tears(rest, rest + 0.4 * along, nothing)
    assert tearing.tears(rest, rest + 1.6 * along, nothing)
    assert not tearing.tears(rest + 1.6 * along, rest + 2.4 * along, nothing)
    # Of vertices that may not move nothing is asked.
    beyond = rest[:, 0] > 150.0
    assert not tearing.tears(rest, rest + 500.0 * beyond[:, None], nothing)


def test_an_edge_of_half_its_length_is_a_tear_but_in_the_bottom_of_a_crease(
    surface: tuple[np.ndarray, Tearing],
) -> None:
    rest, tearing = surface
    near, far = tearing.edges[len(tearing.edges) // 2]
    along = (rest[far] - rest[near]) * (np.arange(len(rest)) == near)[:, None]
    assert not tearing.tears(rest, rest + 0.4 * along, nothing)
    assert tearing.tears(rest, rest + 0.6 * along, nothing)
    assert not tearing.tears(rest + 0.6 * along, rest + 0.7 * along, nothing)
    assert not tearing.tears(rest, rest + 0.6 * along, lambda given: np.arange(len(given)) == far)
    assert tearing.tears(rest, rest + 0.6 * along, lambda given: given[:, 0] < rest[:, 0].min() + 1.0)


def test_a_triangle_that_faces_away_from_all_its_neighbours_is_a_tear() -> None:
    """A triangle in the middle of a plane, whose corners pass each other; its neighbours follow, and stay flat."""
    angles = np.radians([0.0, 120.0, 240.0])
    inner = 10.0 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    places = np.concatenate([inner, -40.0 * inner / 10.0 * [1.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [1, 0, 5], [2, 1, 3], [0, 2, 4]])
    tearing = Tearing.of(places, triangles, np.ones(6, bool), np.zeros(6, bool))
    over = places.copy()
    over[:3] *= -0.5
    assert not tearing.tears(places, np.concatenate([0.5 * inner, places[3:]]), nothing)
    assert tearing.tears(places, over, nothing)
    assert not tearing.tears(over, over, nothing)


def test_a_fine_mesh_may_be_pressed_as_far_as_a_coarse_one() -> None:
    """A plane with edges of two of the solver's units, of which one, so many edges from what crosses, is pressed."""
    x, y = (each.ravel() for each in np.meshgrid(2.0 * np.arange(21), 2.0 * np.arange(5)))
    rest = np.stack([x, y, 0.0 * x], axis=1)
    corners = np.add.outer(21 * np.arange(4), np.arange(20)).reshape(-1, 1)
    triangles = (corners + np.array([0, 1, 22, 0, 22, 21])).reshape(-1, 3)
    tearing = Tearing.of(rest, triangles, np.ones(len(rest), bool), np.zeros(len(rest), bool))

    def torn(place: int) -> bool:
        pressed = rest - 1.4 * (np.arange(len(rest)) == 42 + place)[:, None] * [1.0, 0.0, 0.0]
        return tearing.tears(rest, pressed, lambda _given: rest[:, 0] == 0.0)

    assert [torn(place) for place in (3, 5, 8)] == [False, False, False]
    assert [torn(place) for place in (10, 14)] == [True, True]
