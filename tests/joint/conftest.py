from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.parameters import JOINT_PARAMETERS, internal_units
from tripod_doe.joint.scene import scene
from tripod_doe.study.simulator import point_columns


@pytest.fixture(scope="session")
def internal_points():
    """Points in internal units from named parameters; arrays give several points."""

    def make(**given):
        count = max((np.size(value) for value in given.values()), default=1)
        columns = {name: np.broadcast_to(np.asarray(value, float), (count,)) for name, value in given.items()}
        full = point_columns(scene, {"relative_tolerance": 1e-11}, columns, count)
        return internal_units({n: c for n, c in full.items() if JOINT_PARAMETERS[n].kind != "choice"})

    return make
