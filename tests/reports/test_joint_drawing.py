"""The joint on the page of a study: any kind of factors, and what it says of the sizes of the other points."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.reports.joint_drawing import drawn_joint

SOURCE = {"source": "study"}


def cube_of(**columns):
    size = len(next(iter(columns.values())))
    coords = {
        name: ("point", np.array(column, object if isinstance(column[0], str) else float), SOURCE)
        for name, column in columns.items()
    }
    return xr.Dataset(
        {"outcome": ("point", np.zeros(size, np.int8))},
        coords=coords,
        attrs={"study": '[study]\nname = "t"\n', "fixed_parameters": "{}"},
    )


@pytest.mark.parametrize("word", [True, False])
@pytest.mark.parametrize("at", range(4))
def test_sizes_that_differ_anywhere_are_not_those_of_all_points(at, word):
    """Invariance: whichever point has the other size, also one in the middle of the list."""
    radii = np.full(4, 21.0)
    radii[at] = 24
    beside = {"model": ["kinetostatic"] * 2 + ["equilibrium"] * 2} if word else {"torque_n_m": [-50, 0, 50, 100]}
    assert "All points" not in drawn_joint(cube_of(pitch_radius_mm=radii, **beside))[1]
    assert drawn_joint(cube_of(pitch_radius_mm=np.full(4, 21.0), **beside))[1] == "All points have these sizes."
