"""Suggestions for tubes, spheres and planes of any fineness: none fails, and a bend folds at the same place in all."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kit.shapes import RADIUS, Shape
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.tools.read import parse_tools

# Most vertices of a shape that a quick test looks at.
FEW = 150
MANY = 3000


def suggested(shape: Shape, folder: Path, *, everything: bool = False) -> Suggestions:
    return suggest(shape.asset().write(folder / "shape.glb"), everything=everything)


@st.composite
def shapes(draw: st.DrawFn, most: int) -> Shape:
    """Any shape of 3 to 200 sides, as fine along as the number of vertices allows."""
    sides = draw(st.integers(3, 200) | st.integers(3, 12))
    rings = draw(st.integers(3, max(3, most // sides)))
    rotation, triangle = np.linalg.qr(np.random.default_rng(draw(st.integers(0, 99))).normal(size=(3, 3)))
    rotation = rotation * np.sign(np.diag(triangle))
    rotation[:, 0] *= np.linalg.det(rotation)
    return Shape(
        kind=draw(st.sampled_from(["tube", "sphere", "plane"])),
        sides=sides,
        rings=rings,
        capped=draw(st.booleans()),
        seam=draw(st.booleans()),
        normals=draw(st.booleans()),
        turn=draw(st.sampled_from([None, rotation])),
        place=draw(st.sampled_from([(0.0, 0.0, 0.0), (0.0, 1.5, 0.0), (30.0, -2.0, 0.25)])),
        angle=draw(st.sampled_from([110.0, 5.0, 60.0, 179.0])),
        blend=draw(st.sampled_from([0.5, 1e-9, 0.1, 2.0])),
        inside=draw(st.sampled_from(["z", "x"])),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shapes")


def reads_back(found: Suggestions) -> None:
    """The text has the tools that were found; without tools there is a reason."""
    assert bool(found.tools) == (not found.reason)
    if found.tools:
        assert len(parse_tools(found.text).tools) == len(found.tools) + sum(each.mirrored for each in found.tools)
        assert all(0.0 < each.shortening <= 1.0 for each in found.tools)


@pytest.mark.slow
@pytest.mark.long
@settings(max_examples=3)
@given(shape=shapes(FEW), everything=st.booleans())
def test_no_shape_fails(shape: Shape, everything: bool, folder: Path) -> None:
    reads_back(suggested(shape, folder, everything=everything))


@pytest.mark.slow
@pytest.mark.long
@settings(max_examples=10)
@given(shape=shapes(MANY), everything=st.booleans())
def test_no_fine_shape_fails(shape: Shape, everything: bool, folder: Path) -> None:
    reads_back(suggested(shape, folder, everything=everything))


TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
# Rings are at most half a radius apart, and skin weights change over more than a radius.
BENT = [
    Shape(sides=8, rings=17),
    Shape(sides=12, rings=24, seam=True, capped=True),
    # The mean of the sites that fold lies further within the tube than a neighbourhood of sites reaches.
    Shape(sides=24, rings=40, blend=0.8),
    Shape(sides=16, rings=20, inside="x"),
    Shape(sides=16, rings=24, turn=TURNED, place=(3.0, -1.0, 2.0)),
    Shape(sides=10, rings=24, turn=TURNED, seam=True, normals=False),
    Shape(sides=60, rings=120, angle=60.0),
    Shape(sides=90, rings=160, angle=70.0, blend=0.4),
    Shape(sides=200, rings=17, seam=True),
    Shape(sides=200, rings=40, turn=TURNED, capped=True),
]


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize("shape", BENT, ids=lambda each: f"{each.sides}x{each.rings}")
def test_a_bent_tube_folds_at_the_same_place_however_fine(tmp_path: Path, shape: Shape) -> None:
    # The place is tested, not the look: facets that bend, and a crease as sharp as a bump, leave tools out.
    best = suggested(shape, tmp_path, everything=True).tools[0]
    first, *_, last = (
        (np.array(point) - shape.place) @ shape.rotation() for point in best.tool.points if isinstance(point, tuple)
    )
    if shape.inside == "x":
        # Tools of a symmetric body are a pair, and the one that the clip folds is written.
        assert best.mirrored
    x, y, z = (first + last) / 2.0
    inwards = x if shape.inside == "x" else z
    assert abs(y) < 0.05
    assert inwards > 0.5 * np.hypot(x, z)
    assert np.hypot(x, z) == pytest.approx(RADIUS, rel=0.1)
    assert abs((last - first)[1]) > 0.97 * np.linalg.norm(last - first)
    assert RADIUS < best.span < 3.0 * RADIUS
    assert best.shortening > 0.3
    assert (best.driver, best.clip) == ("upper", "bend")
    assert 0.5 < best.time < 1.5
