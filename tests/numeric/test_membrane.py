"""A tethered membrane slides as its differential equation says, and triangles that turn over are seen."""

import numpy as np
import pytest

from wrinklecli.numeric.membrane import POISSON, Membrane, stretches


def sheet(cells: int, length: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(0, length, cells + 1), np.linspace(0, width, 5), indexing="ij")
    positions = np.stack([x.reshape(-1), y.reshape(-1), np.zeros(x.size)], axis=1)
    numbers = np.arange(x.size).reshape(x.shape)
    a, b, c, d = numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]
    return positions, np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])


def test_a_slide_fades_exponentially() -> None:
    """Drawn along by a load at one end, u'' = u / ℓ²; a free strip narrows, which makes it softer by at most 1 - ν²."""
    positions, triangles = sheet(200, 1.0, 0.02)
    axes = np.stack([np.tile([1.0, 0, 0], (len(positions), 1)), np.tile([0, 1.0, 0], (len(positions), 1))])
    reach = 0.1
    membrane = Membrane(positions, triangles, axes, np.full(len(positions), 1 / reach**2), positions[:, 0] > 0.999)
    loads = (positions[:, 0] < 1e-9)[None, :, None] * np.array([1.0, 0.0, 0.0])
    (found,) = membrane.slides(loads)
    line = np.isclose(positions[:, 1], 0.01) & (positions[:, 0] > 0.05) & (positions[:, 0] < 0.4)
    length = -1.0 / np.polyfit(positions[line, 0], np.log(found[line, 0]), 1)[0]
    assert np.sqrt(1.0 - POISSON**2) * reach * 0.99 < length < 1.01 * reach


def test_the_least_stretch_is_that_of_the_triangle() -> None:
    before = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    squeezed = before * [0.3, 1.0, 1.0]
    turned = before * [-0.3, 1.0, 1.0]
    tilted = before @ np.array([[1.0, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]])
    assert [float(stretches(before, each)[0]) for each in (squeezed, turned, tilted)] == pytest.approx([0.3, -0.3, 1.0])
