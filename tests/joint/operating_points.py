"""Blocks of operating points for tests."""

from __future__ import annotations

import numpy as np

from tripod_doe.joint.simulator import simulator


def points(**varied):
    """Every parameter of one or more joints: those of the reference joint, but for some."""
    count = max(np.size(value) for value in varied.values())
    columns = {name: np.broadcast_to(np.asarray(value), (count,)) for name, value in varied.items()}
    return simulator.columns(
        {}, {name: simulator.parameters[name].column(column.tolist()) for name, column in columns.items()}, count
    )
