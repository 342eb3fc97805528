"""Sites: points spread over a surface, whose sums are those of the surface, and which are near to each other on it."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest

from kit.asset import plate
from kit.limb import RADIUS, limb_asset
from kit.prepared import unattached
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.surface.sites import Sites, spread_sites
from wrinklecli.surface.strain import read_gauge


@cache
def sites_of(rings: int, sides: int) -> Sites:
    made = unattached(limb_asset(rings=rings, sides=sides))
    return spread_sites(read_gauge(made.surface, made.rest, made.rig))


def corners_of(sites: Sites) -> tuple[Floats, Floats]:
    """(triangles, 3, 3) corners of the surface's triangles, and (triangles,) their areas."""
    corners = sites.gauge.rest.positions[sites.gauge.triangles]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, np.linalg.norm(crosses, axis=1) / 2.0


SIZES = pytest.mark.parametrize("size", [(4, 6), (9, 8)], ids=str)


@SIZES
def test_each_triangle_has_its_share_of_the_sites_around_it(size: tuple[int, int]) -> None:
    sites = sites_of(*size)
    corners, areas = corners_of(sites)
    assert sites.areas @ sites.gather == pytest.approx(areas)
    assert sites.areas @ sites.positions == pytest.approx(areas @ corners.mean(axis=1), abs=1e-12)


@SIZES
def test_sites_lie_on_the_surface_and_face_as_it_does(size: tuple[int, int]) -> None:
    sites = sites_of(*size)
    sides = size[1]
    apart = np.hypot(sites.positions[:, 1], sites.positions[:, 2])
    # A cell may have parts of two sides of the tube.
    assert apart.max() <= RADIUS + 1e-12
    assert apart.min() > RADIUS * np.cos(np.pi / sides) - sites.spacing**2 / RADIUS
    around = unit(sites.positions * [0.0, 1.0, 1.0])
    assert np.einsum("pk,pk->p", sites.normals, around).min() > np.cos(np.pi / sides + sites.spacing / RADIUS)


@SIZES
def test_a_neighbourhood_has_what_is_within_its_radius(size: tuple[int, int]) -> None:
    """A site counts by its area, and by less the farther it is from the middle."""
    sites = sites_of(*size)
    near, smooth = sites.near.toarray().astype(np.float64), sites.smooth.toarray()
    apart = np.linalg.norm(sites.positions[:, None] - sites.positions, axis=2)
    assert (near == near.T).all()
    assert near.any(axis=1).all()
    assert apart[near > 0].max() <= sites.radius
    expected = sites.areas * np.maximum(1.0 - (apart / sites.radius) ** 2, 0.0) ** 2
    ratios = smooth / (smooth.diagonal() / sites.areas)[:, None]
    assert ratios[smooth > 0] == pytest.approx(expected[smooth > 0])
    reached = near + near @ near + near @ near @ near > 0
    assert ((smooth > 0) | np.eye(len(near), dtype=bool))[reached & (apart < sites.radius)].all()
    assert not smooth[apart > sites.radius].any()


def test_sheets_that_face_away_and_pieces_that_do_not_touch_are_no_neighbours() -> None:
    """Two thin plates beside each other, each of two sheets."""
    rows = np.stack(np.meshgrid(np.arange(9), np.arange(9), indexing="ij"), axis=-1).reshape(-1, 2) / 8.0
    faces = np.array(
        [[9 * i + j + k for k in ks] for i in range(8) for j in range(8) for ks in ((0, 9, 10), (0, 10, 1))]
    )
    sheets = [(x, z) for x in (0.0, 1.01) for z in (0.0, 0.01)]
    positions = [np.insert(rows, 2, z, axis=1) + np.array([x, 0.0, 0.0]) for x, z in sheets]
    wound = [(faces if z else faces[:, ::-1]) + 81 * number for number, (_, z) in enumerate(sheets)]
    made = unattached(plate(np.concatenate(positions), np.concatenate(wound)))
    sites = spread_sites(read_gauge(made.surface, made.rest, made.rig))
    x, _, z = sites.positions.T
    assert sites.normals[:, 2] == pytest.approx(np.where(z > 0.005, 1.0, -1.0))
    sheet = 2 * (x > 1.005) + (z > 0.005)
    for here, there in combinations(range(4), 2):
        assert not sites.near[np.flatnonzero(sheet == here)][:, sheet == there].nnz
        assert not sites.smooth[np.flatnonzero(sheet == here)][:, sheet == there].nnz
        assert not {*sites.pieces[sheet == here]} & {*sites.pieces[sheet == there]}
