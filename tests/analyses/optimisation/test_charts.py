"""Charts of a search."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import xarray as xr

from tripod_doe.analyses.optimisation import charts


def test_waveforms_of_any_number_of_joints(monkeypatch):
    """Regression: the fifth line, of three objectives with a knee, ended the search without its report."""
    monkeypatch.setattr(charts, "values_text", lambda problem, at: "10 deg")
    angle, joints = np.arange(0.0, 360, 10), 8
    course = np.arange(1, joints + 1)[:, None] * np.sin(np.radians(3 * angle))
    waves = xr.Dataset(
        {
            "thrust": (("place", "joint", "rotation_deg"), course[None]),
            "thrust_amplitude": (("place", "joint", "order"), np.ones((1, joints, 4))),
        },
        {"joint": [f"joint {k}" for k in range(joints)], "rotation_deg": angle, "order": np.arange(4)},
    )
    drawn = charts._waveforms(
        SimpleNamespace(operating=SimpleNamespace(values=np.zeros((1, 1))), model="equilibrium"), waves
    )
    assert len(drawn[0].figure.axes[0].lines) == joints
