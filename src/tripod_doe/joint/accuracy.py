"""Accuracy that a run must reach, by order of the thrust."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.values import JointValues
from tripod_doe.model_interface import Accuracy

SMALLEST_THIRD = 2e-3
"""Least reference of the third order's relative error, over |T| / R_p: for small orders, as of a straight joint."""


@dataclass(frozen=True)
class OrderAccuracy:
    """Allowed errors of the orders of the thrust."""

    orders: Mapping[int, float]  # allowed relative error by order
    floor: float = 0.01  # least reference of relative errors, over the largest order

    @classmethod
    def of(cls, accuracy: Accuracy) -> OrderAccuracy:
        """Make it from the required accuracy of a study."""
        return cls({each.label: each.allowed for each in accuracy.quantities if each.label is not None}, accuracy.floor)

    def sizes(self, amplitudes: FloatArray, values: JointValues[float]) -> FloatArray:
        """References of relative errors, for orders of these amplitudes; shape (order,)."""
        least = SMALLEST_THIRD * abs(values.torque) / values.pitch_radius
        sizes: FloatArray = np.maximum(amplitudes, self.floor * max(float(amplitudes[1:].max()), least))
        sizes[3] = max(sizes[3], least)
        return sizes

    def allowed(self, amplitudes: FloatArray, values: JointValues[float]) -> FloatArray:
        """Allowed errors of orders of these amplitudes, infinite without requirement; shape (order,)."""
        errors, sizes = np.full(ORDERS.size, math.inf), self.sizes(amplitudes, values)
        for order, share in self.orders.items():
            errors[order] = share * sizes[order]
        return errors
