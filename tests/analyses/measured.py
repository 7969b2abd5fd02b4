"""Measurements made of known orders: what a recorder would write, with noise, drift, pulses and dropouts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Recorder:
    """A thrust of known orders {k: (A_k, p_k in deg)}, turned with a linear run-up and sampled in time."""

    orders: dict[int, tuple[float, float]] = field(default_factory=lambda: {0: (2.0, 0), 2: (4.0, 40), 3: (14.0, -75)})
    revolutions: float = 20.2
    rpm: tuple[float, float] = (600.0, 600.0)
    rate_hz: float = 10_000.0
    noise_n: float = 0.0
    pulses: int = 1
    duty: float = 0.5
    start_deg: float = -40.0  # angle of the first sample; the tachometer rises at 0
    seed: int = 0

    def thrust(self, rotation_deg):
        phi = np.radians(rotation_deg)
        return sum(a * np.cos(k * phi + np.radians(p)) for k, (a, p) in self.orders.items())

    def record(self) -> pd.DataFrame:
        """Columns time_s, thrust_n, tacho, and the true rotation_deg under the name ``true_deg``."""
        first, last = (6.0 * rpm for rpm in self.rpm)  # deg/s
        duration = 720 * self.revolutions / (first + last)
        time = np.arange(0, duration, 1 / self.rate_hz)
        rotation = self.start_deg + first * time + (last - first) * time**2 / (2 * duration)
        noise = self.noise_n * np.random.default_rng(self.seed).standard_normal(time.size)
        tacho = 5.0 * ((rotation * self.pulses / 360) % 1 < self.duty)
        return pd.DataFrame(
            {"time_s": time, "thrust_n": self.thrust(rotation) + noise, "tacho": tacho, "true_deg": rotation}
        )
