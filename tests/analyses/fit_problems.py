"""Published nonlinear problems as fits: NIST StRD with its certified values, and models that are made up."""

from __future__ import annotations

import numpy as np

from tripod_doe.analyses.fit.estimation.misfit import Rows
from tripod_doe.analyses.fit.estimation.unknowns import Unknown, make_layout
from tripod_doe.analyses.fit.model_error import Needles

MISRA1A = np.array(
    [
        [77.6, 10.07], [114.9, 14.73], [141.1, 17.94], [190.8, 23.93], [239.9, 29.61], [289.0, 35.18], [332.8, 40.02],
        [378.4, 44.82], [434.8, 50.76], [477.3, 55.05], [536.8, 61.01], [593.1, 66.40], [689.1, 75.47], [760.0, 81.78],
    ]
)  # fmt: skip
"""Misra1a of NIST's StRD (Misra 1978): x, y."""

THURBER = np.array(
    [
        [-3.067, 80.574], [-2.981, 84.248], [-2.921, 87.264], [-2.912, 87.195], [-2.840, 89.076], [-2.797, 89.608],
        [-2.702, 89.868], [-2.699, 90.101], [-2.633, 92.405], [-2.481, 95.854], [-2.363, 100.696], [-2.322, 101.060],
        [-1.501, 401.672], [-1.460, 390.724], [-1.274, 567.534], [-1.212, 635.316], [-1.100, 733.054],
        [-1.046, 759.087], [-0.915, 894.206], [-0.714, 990.785], [-0.566, 1090.109], [-0.545, 1080.914],
        [-0.400, 1122.643], [-0.309, 1178.351], [-0.109, 1260.531], [-0.103, 1273.514], [0.010, 1288.339],
        [0.119, 1327.543], [0.377, 1353.863], [0.790, 1414.509], [0.963, 1425.208], [1.006, 1421.384],
        [1.115, 1442.962], [1.572, 1464.350], [1.841, 1468.705], [2.047, 1447.894], [2.200, 1457.628],
    ]
)  # fmt: skip
"""Thurber of NIST's StRD (semiconductor electron mobility, 1979): x, y."""


def real_rows(values, deviation):
    """Real measured values as rows of one record, whose angle is known."""
    count = values.size
    return Rows(
        record=np.zeros(count, int),
        order=np.ones(count, int),
        measured=values.astype(complex),
        along=np.full(count, float(deviation)),
        across=np.full(count, np.inf),
        own_error=np.zeros((2, count)),
        shared=np.zeros((count, 0), complex),
        turning=np.zeros((count, 0)),
        free_phase=np.zeros(1, bool),
        free_sign=np.zeros(1, bool),
    )


def one_record(bounds):
    """A layout with one scalar for each unknown."""
    unknowns = [Unknown(f"b{number}", low, high) for number, (low, high) in enumerate(bounds, 1)]
    return make_layout(unknowns, ["data"], [[""]] * len(unknowns))


def model_of(layout, function):
    """A function of (trial, unknown) -> (trial, row) as the search takes it."""

    def predict(places):
        return function(layout.values(places)[:, 0]).astype(complex)

    return predict


def answers(every, stay=False):
    """A made-up joint: orders in proportion to torque and frictions, needles that turn more at large angles."""
    angle, torque, needle = (
        np.asarray(every[name], float) for name in ("joint_angle_deg", "torque_n_m", "needle_sliding_friction")
    )
    initial = np.stack([np.asarray(every[f"initial_skew_{at}_deg"], float) for at in (1, 2, 3)], axis=1)
    skew = initial * (1 if stay else 1.0 - 0.055 * angle[:, None])
    second = (2 * torque * needle)[:, None] * np.exp(2j * np.radians(120) * np.arange(3)) * skew
    orders = np.zeros((angle.size, 13), complex)
    orders[:, 2], orders[:, 3] = second.sum(axis=1), 1j * torque * np.radians(angle) * (4 + 40 * needle)
    return orders, Needles(second, skew)
