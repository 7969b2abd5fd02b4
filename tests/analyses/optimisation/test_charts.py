"""Charts of a search, and what is read from a stored one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import xarray as xr

from tripod_doe.analyses.optimisation import charts
from tripod_doe.analyses.optimisation.stored_candidates import base_of


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


def test_a_candidate_with_words_has_its_base():
    """Regression: a text of a stored front has no item(), so *Take this one* of a search over models failed."""
    front = xr.Dataset(
        {
            "model": ("candidate", np.array(["equilibrium", "kinetostatic"], object), {"role": "variable"}),
            "knee": ("candidate", [0, 1]),
        },
        attrs={
            "optimisation": '[optimisation]\nname = "t"\n[variables.model]\nvalues = ["equilibrium", "kinetostatic"]\n'
            '[objectives.third]\noutput = "thrust_amplitude"\norder = 3\n'
        },
    )
    assert base_of(front, 1) == '[base]\nmodel = "kinetostatic"\n'


def test_parallel_axes_reach_over_the_whole_front_and_show_its_knee():
    """Regression: of a front of more than 60 candidates, ends of axes and the knee could be among those left out."""
    units = np.linspace(0, 1, 150)[:, None]
    aims = np.concatenate([units, 1 - units], axis=1)
    aims[74] = 0.2  # the knee
    problem = SimpleNamespace(
        objectives={"a": None, "b": None},
        signs=np.ones(2),
        variables=SimpleNamespace(columns=lambda at: {"x": np.where(np.arange(150) == 73, 9.0, at[:, 0])}),
    )
    front = SimpleNamespace(units=units, judged=SimpleNamespace(objectives=aims))
    chart = charts._parallel(problem, SimpleNamespace(front=front))
    assert chart.caption.startswith(f"{len(chart.data)} of the 150 candidates of the front")
    assert {74} <= set(chart.data["candidate"])
    assert "9" in {text.get_text() for text in chart.figure.axes[0].texts}
