"""Shapes of contact with signed weights, as targets whose weights are not below 0."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from wrinklecli.effects.contact.effect import NonNegativeBasis
from wrinklecli.numeric.arrays import Floats


@given(
    arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.floats(-1.0, 1.0, width=32)),
    st.floats(0.1, 10.0),
)
def test_weights_are_from_0_to_1_and_mean_the_signed_ones(parts: Floats, greatest: float) -> None:
    signed = greatest * parts
    basis = NonNegativeBasis(signed.shape[1], greatest)
    weights = basis.weights(signed)
    assert weights.shape == (len(signed), signed.shape[1] + 1)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0 + 1e-12
    assert weights @ basis.unmix == pytest.approx(signed, abs=1e-9 * greatest)


def test_weights_that_are_not_negative_need_no_further_shape() -> None:
    basis = NonNegativeBasis(2, 1.5)
    assert basis.weights(np.array([[0.3, 1.5]])) == pytest.approx(np.array([[0.1, 0.5, 0.0]]))
