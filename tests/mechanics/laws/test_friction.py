"""Laws of contact and friction."""

from __future__ import annotations

import numpy as np

from tripod_doe.mechanics.laws.friction import hyperbolic_tangent


def test_hyperbolic_tangent_is_that_of_the_c_library():
    """Exact: 1e-14 relative is what the docstring promises."""
    x = np.concatenate([np.geomspace(1e-12, 25, 2000), [0.0, 700.0]])
    ours = np.array([hyperbolic_tangent(value) for value in x])
    np.testing.assert_allclose(ours, np.tanh(x), rtol=1e-14)
    assert hyperbolic_tangent(-1.5) == -hyperbolic_tangent(1.5)
    assert np.isnan(hyperbolic_tangent(np.nan))
