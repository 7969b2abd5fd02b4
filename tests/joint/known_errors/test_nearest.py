"""The known places nearest to many others are those that all distances in order give."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.known_errors.nearest import nearest_rows

SHAPES = {"plane": (2, 1.0), "ratios": (7, 1.0), "far apart": (3, [1.0, 1e6, 0.0])}


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("count", [1, 10])
def test_nearest_rows_of_many_places(kind, count):
    """Exact: of places that lie on a lattice, so that many are equally near, the first known ones count."""
    width, spread = SHAPES[kind]
    random = np.random.default_rng(7)
    known = np.round(random.normal(size=(300, width)), 1) * spread
    places = np.round(random.normal(size=(3000, width)), 1) * spread
    apart = np.square(places[:, None, :] - known)
    distances = sum(apart[:, :, axis] for axis in range(width))
    expected = np.argsort(distances, axis=1, kind="stable")[:, :count]
    np.testing.assert_array_equal(nearest_rows(known, places, count), expected)


def test_places_that_are_all_the_same():
    known = np.arange(20.0)[:, None]
    assert (nearest_rows(known, np.full((600, 1), 7.2), 3) == [7, 8, 6]).all()


def test_fewer_known_places_than_are_asked_for():
    assert (nearest_rows(np.array([[1.0], [5.0]]), np.full((600, 1), 4.0), 9) == [1, 0]).all()
