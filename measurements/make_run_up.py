"""Makes run_up.csv: a synthetic measurement, so that `tripod-doe compare` can be tried without a test rig.

No joint was measured. The record is what a rig with a force cell and a tachometer might write when the reference joint
(10 deg, 50 N m) runs up from 300 to 900 rpm in 6 s: 1,000 samples per second, one pulse per revolution over a tenth of
a turn, white noise of 0.8 N, and these rotating orders, which rise linearly with speed:

    order   amplitude at 300 rpm   at 900 rpm   phase
      0           2.0 N               2.0 N        0 deg
      1           0.6 N               1.4 N      -35 deg   (imbalance of the rig)
      2           0.5 N               0.5 N       40 deg
      3          14.2 N              14.9 N     -105 deg
      6           0.4 N               0.5 N       80 deg

The numbers are chosen near those of the reference joint; they are no result of a model.

Run as: python measurements/make_run_up.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

ORDERS = {0: (2.0, 2.0, 0.0), 1: (0.6, 1.4, -35.0), 2: (0.5, 0.5, 40.0), 3: (14.2, 14.9, -105.0), 6: (0.4, 0.5, 80.0)}
LOW, HIGH, SECONDS, RATE = 300.0, 900.0, 6.0, 1000.0
NOISE, PULSE, START_DEG = 0.8, 0.1, -100.0


def run_up() -> str:
    """The text of the record."""
    time = np.arange(0, SECONDS, 1 / RATE)
    part = time / SECONDS
    rotation = START_DEG + 6 * (LOW * time + (HIGH - LOW) * time**2 / (2 * SECONDS))
    thrust = NOISE * np.random.default_rng(0).standard_normal(time.size)
    for order, (low, high, phase) in ORDERS.items():
        thrust += (low + (high - low) * part) * np.cos(np.radians(order * rotation + phase))
    tacho = 5 * ((rotation / 360) % 1 < PULSE)
    rows = [f"{t:.3f},{force:.2f},{pulse:.0f}" for t, force, pulse in zip(time, thrust, tacho, strict=True)]
    head = (
        "# synthetic, not measured: made by measurements/make_run_up.py, which says how\n"
        "# joint angle: 10 deg, torque: 50 N m"
    )
    return "\n".join([head, "time_s,thrust_n,tacho", *rows]) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("run_up.csv").write_text(run_up(), encoding="utf-8")
