"""The shapes of a tool on texels: the first place under a texel counts, and samples are averaged."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.texture import maps

# Over the left half of a texture, and the same again.
HALF = np.array([[[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]], [[0.0, 0.0], [0.5, 1.0], [0.0, 1.0]]])


class Relief:
    """Each texel is as high as its triangle's number; the slopes are twice and three times as much."""

    numbers = (7,)

    def at(self, _: object, faces: Ints, shares: Floats) -> tuple[Floats, Floats]:
        assert shares.sum(axis=1) == pytest.approx(np.ones(len(faces)))
        heights = 1.0 + faces[None, :]
        return heights, heights[:, :, None] * np.array([2.0, 3.0])


@pytest.mark.parametrize("chunk", [1, 10**6])
@pytest.mark.parametrize("factor", [1, 2])
def test_the_first_of_two_places_counts_however_many_are_worked_out_at_once(
    chunk: int, factor: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wrinklecli.numeric.portions.AT_ONCE", chunk)
    effect: Any = SimpleNamespace(name="tool", targets=(SimpleNamespace(number=7, name="bump"),))
    options: Any = SimpleNamespace(size=8, supersample=factor)
    uvs = np.concatenate([HALF, HALF])
    (made,) = maps._shown(effect, Relief(), None, uvs, np.arange(4), options)  # type: ignore[arg-type]
    assert made.texels.tolist() == [8 * row + column for row in range(8) for column in range(4)]
    assert made.heights.min() >= 1.0
    assert made.heights.max() <= 2.0
    assert set(made.heights.tolist()) >= {1.0, 2.0}
    assert made.slopes == pytest.approx(made.heights[:, None] * np.array([2.0, 3.0]))
    none = maps._shown(effect, Relief(), None, uvs, np.zeros(0, np.intp), options)  # type: ignore[arg-type]
    assert none == []
