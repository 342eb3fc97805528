"""Rays see what is nearest, and Embree is not asked for what it cannot have."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kit.limb import limb_asset
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.preview.rays import Occluders, _seen, first_hits, in_sight, trace

MAIN = "from wrinklecli.cli import main; main()"


@pytest.mark.slow
@pytest.mark.parametrize("size", ["50MB", "150MB"])
def test_too_little_memory_is_a_line_and_no_crash(tmp_path: Path, size: str) -> None:
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    command = [sys.executable, "-c", MAIN, "preview", tmp_path / "limb.glb", "-o", tmp_path / "limb.png"]
    ended = subprocess.run([*command, "--max-memory", size], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1)
    assert "takes more memory than there is" in ended.stderr


@pytest.fixture(params=["Embree", "libigl"])
def rays(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs a test with Embree, and as where it is not installed."""
    if request.param == "libigl":
        monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    else:
        pytest.importorskip("embreex.mesh_construction")


@pytest.mark.quick(1)
@pytest.mark.usefixtures("rays")
def test_a_pixel_shows_the_nearest_triangle_that_its_middle_lies_in() -> None:
    side, rng = 80, np.random.default_rng(5)
    # Some triangles are larger than the picture, some smaller than a pixel, and some beside it.
    corners = rng.normal(size=(300, 1, 3)) + 10.0 ** rng.uniform(-3.0, 0.5, (300, 1, 1)) * rng.normal(size=(300, 3, 3))
    normals = unit(rng.normal(size=(300, 3, 3)))
    hits = first_hits(trace(corners, normals, 0.0), (side, side), 0, np.arange(side * side), np.zeros((1, 2)))
    numbers = np.full(side * side, -1)
    numbers[hits.pixels] = hits.triangles
    down, across = np.mgrid[:side, :side].reshape(2, -1)
    x, y = (2 * across + 1) / side - 1, 1 - (2 * down + 1) / side
    depths, nearest, close = np.full(side * side, -np.inf), np.full(side * side, -1), np.zeros(side * side, bool)
    for number, (a, b, c) in enumerate(corners):
        shares = np.linalg.solve(np.stack([*np.stack([a, b, c]).T[:2], np.ones(3)]), np.stack([x, y, np.ones_like(x)]))
        deep = np.array([a[2], b[2], c[2]]) @ shares
        near = (shares >= 0).all(axis=0) & (deep > depths)
        close |= (np.abs(shares) < 1e-4).any(axis=0)
        depths[near], nearest[near] = deep[near], number
    # Rays are float32: pixels on the edges of triangles may see either side.
    assert np.array_equal(numbers[~close], nearest[~close])
    assert close.mean() < 0.2
    at = np.einsum("pk,pka->pa", hits.weights, corners[hits.triangles])
    assert at[:, :2] == pytest.approx(np.stack([x, y], axis=1)[hits.pixels], abs=1e-4)
    assert hits.directions == pytest.approx(np.tile([0.0, 0.0, -1.0], (len(at), 1)))


@pytest.mark.usefixtures("rays")
def test_what_lies_between_a_point_and_an_eye_hides_it() -> None:
    """A square at z = 1 is over one of two points that face up, and one that faces down sees nothing above."""
    square = np.array([[[0, 0, 1], [1, 0, 1], [1, 1, 1]], [[0, 0, 1], [1, 1, 1], [0, 1, 1]]], float)
    points = np.array([[0.4, 0.5, 0.0], [2.0, 0.5, 0.0], [2.0, 0.5, 0.0]])
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    occluders, up = Occluders.of(square), np.array([0.0, 0.0, 1.0])
    aside = unit(np.array([3.0, 0.0, 1.0]))
    far = occluders.free(points, normals, np.stack([up, aside, -up]))
    assert far.tolist() == [[False, True, False], [True, True, False], [False, False, True]]


@pytest.mark.usefixtures("rays")
def test_rays_go_on_behind_what_lets_light_through() -> None:
    """Three panes of which each takes half of the light, seen straight and aslant."""
    pane = np.array([[[-9, -9, 0], [9, -9, 0], [0, 18, 0]]], float)
    corners = np.concatenate([pane + np.array([0.0, 0.0, z]) for z in (-3.0, -1.0, -2.0)])
    surface = trace(corners, np.tile([0.0, 0.0, 1.0], (3, 3, 1)))
    eyes = np.zeros((2, 3), np.float32)
    directions = unit(np.array([[0.0, 0.0, -1.0], [1.0, 0.5, -1.0]])).astype(np.float32)
    for opacity, count in ((None, 1), (lambda triangles, _: np.full(len(triangles), 0.5, np.float32), 3)):
        numbers, triangles, weights, depths, shares = _seen(surface, eyes, directions, opacity)
        for ray, direction in enumerate(directions):
            of_ray = numbers == ray
            assert triangles[of_ray].tolist() == [1, 2, 0][:count]
            assert depths[of_ray] == pytest.approx((np.array([1.0, 2.0, 3.0]) / -direction[2])[:count], rel=1e-3)
            assert shares[of_ray] == pytest.approx([1.0] if count == 1 else [0.5, 0.25, 0.125])
            places = np.einsum("hk,hkx->hx", weights[of_ray], corners[triangles[of_ray]])
            assert places == pytest.approx(depths[of_ray, None] * direction, abs=1e-2)


@pytest.mark.usefixtures("rays")
@pytest.mark.parametrize(("tangent", "shown"), [(0.0, [False, True]), (0.25, [False, False])])
def test_a_point_is_in_sight_unless_a_triangle_is_between_it_and_the_eye(tangent: float, shown: list[bool]) -> None:
    """A pane at z = 1 hides what is behind it; an eye at z = 4 sees a point further aside through it, too."""
    pane = np.array([[[-9, -9, 1], [1, -9, 1], [1, 9, 1]], [[-9, -9, 1], [1, 9, 1], [-9, 9, 1]]], float)
    surface = trace(pane, np.tile([0.0, 0.0, 1.0], (2, 3, 1)), tangent)
    behind = np.array([[0.5, 0.1, 0.0], [1.2, 0.1, 0.0]])
    points = np.concatenate([behind, behind + np.array([0.0, 0.0, 2.0]), [[0.5, 0.1, 1.0]]])
    assert in_sight(surface, points).tolist() == [*shown, True, True, True]


def test_where_there_is_no_triangle_nothing_hides_anything() -> None:
    """A scene is empty where a tool's mesh is hidden at the moment of a review."""
    occluders = Occluders.of(np.zeros((0, 3, 3)))
    point, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    assert occluders.free(point, up, up).all()
