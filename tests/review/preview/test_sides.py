"""The side from which a place is looked at, and the light that shows its relief."""

from dataclasses import replace

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Bools, Floats, unit
from wrinklecli.review.preview.sides import (
    ANGLES,
    FACES,
    LEVELS,
    Free,
    Place,
    Side,
    best_light,
    best_moment,
    best_side,
    side_above,
)

HEIGHT = 0.02


def sheet(across: int) -> Place:
    """A sheet that faces +z, with crests that follow each other along x (0) or y (1)."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41), indexing="ij")
    plain = np.stack([x, y, np.zeros_like(x)], axis=2)
    wrinkled = plain + HEIGHT * np.cos(6 * np.pi * plain[..., across])[..., None] * np.array([0.0, 0.0, 1.0])

    def corners(grid: Floats) -> Floats:
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)

    return Place.of(corners(plain), corners(wrinkled))


def free_but(away: tuple[float, float, float], place: Place) -> Free:
    """The part of the directions that a wall on one side leaves free."""

    def free(directions: Floats) -> Bools:
        return np.repeat((directions @ np.array(away) < 0.3)[:, None], len(place.points), axis=1)

    return free


@pytest.mark.parametrize("across", [0, 1])
def test_the_key_light_rakes_across_the_crests(across: int) -> None:
    place = sheet(across)
    light = best_light(place, np.eye(3), lambda ways: np.ones((len(ways), len(place.points)), np.bool_))
    assert np.linalg.norm(light) == pytest.approx(1.0)
    assert abs(light[across]) > 3.0 * abs(light[1 - across])
    assert light[1] > -1e-9, "from above, where both ends are as good"


@pytest.mark.parametrize("wall", [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
def test_the_key_light_comes_from_where_nothing_shades_the_place(wall: tuple[float, float, float]) -> None:
    place = sheet(1)
    light = best_light(place, np.eye(3), free_but(wall, place))
    assert light @ np.array(wall) < -0.6


@pytest.mark.parametrize("seed", range(5))
def test_the_best_side_is_the_best_of_all(seed: int) -> None:
    place = sheet(0)
    azimuths, elevations = np.radians(ANGLES).T
    directions = np.stack(
        [np.sin(azimuths) * np.cos(elevations), np.sin(elevations), np.cos(azimuths) * np.cos(elevations)], axis=1
    )
    away = unit(np.random.default_rng(seed).normal(size=3))
    seen: list[Floats] = []

    def free(backs: Floats) -> Bools:
        seen.extend(backs)
        return np.repeat((backs @ away < 0.3)[:, None], len(place.points), axis=1)

    side = best_side(place, free)
    scores = np.clip(directions @ place.normals.T, 0.0, 0.7) * free(directions) @ (place.areas * place.heights)
    assert side.score * LEVELS[ANGLES.index(side.angles)] > 0.8 * np.max(scores * LEVELS)
    assert side.score == pytest.approx(scores[ANGLES.index(side.angles)])
    assert 0.0 < side.visible <= 1.0
    assert len(seen) - len(ANGLES) < len(ANGLES) / 3, "sides that cannot be the best are not looked at"


def test_what_a_fold_hides_is_looked_at_earlier() -> None:
    place = sheet(0)
    side = best_side(place, lambda ways: np.ones((len(ways), len(place.points)), np.bool_))
    looks = {1.0: (2.0, 0.2), 0.85: (2.1, 0.4), 0.7: (3.0, 0.6), 0.55: (3.1, 0.8), 0.4: (9.0, 0.9)}

    def look(time: float) -> tuple[float, Side]:
        score, visible = looks[round(time, 2)]
        return time, Side(side.angles, score, visible)

    assert best_moment(0.0, 1.0, look)[0] == pytest.approx(0.55)


def test_a_place_is_seen_from_straight_above_unless_much_is_hidden_there() -> None:
    place = sheet(0)
    above = side_above(place, lambda ways: np.ones((len(ways), len(place.points)), np.bool_))
    assert above.angles == (0, 0)
    assert above.visible > 0.9
    half = np.arange(len(place.points)) % 2 == 0
    hidden = side_above(place, lambda ways: ~(ways[:, 2:] > 0.95) | half)
    assert hidden.axes[2, 2] <= 0.95
    assert hidden.visible > 0.6


def test_the_normal_of_a_place_is_that_of_most_of_its_wrinkles() -> None:
    """A triangle counts by its area times its height."""
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    place = Place(np.zeros((2, 3)), normals, normals, np.array([2.0, 1.0]), np.array([1.0, 4.0]))
    above = side_above(place, lambda ways: np.ones((len(ways), 2), np.bool_))
    assert above.angles == (63, 0)
    x, _, z = above.axes[2]
    assert x > FACES
    assert above.score == pytest.approx(4.0 * FACES + 2.0 * z)
    assert above.visible == pytest.approx(above.score / (6.0 * FACES))


@pytest.mark.parametrize("normal", [*np.eye(3), *-np.eye(3), *unit(np.random.default_rng(4).normal(size=(8, 3)))])
def test_straight_above_is_along_the_normal_of_a_place_whichever_way_it_faces(normal: Floats) -> None:
    place = sheet(0)
    right = unit(np.cross([0.3, 0.5, 0.8], normal))
    turn = np.stack([right, np.cross(normal, right), normal])
    turned = replace(
        place, points=place.points @ turn, plain_normals=place.plain_normals @ turn, normals=place.normals @ turn
    )
    above = side_above(turned, lambda ways: np.ones((len(ways), len(place.points)), np.bool_))
    # Angles are whole degrees, and 89 up or down at most.
    assert above.axes[2] @ normal > np.cos(np.radians(1.01))
