"""Makes the records in rig/: synthetic measurements, so that `tripod-doe fit` can be tried without a test rig.

No joint was measured. The records are what a rig with a force cell and an encoder might write of a joint whose hidden
values are those of TRUTH, as the model `kinetostatic` has it, at eight operating points: eight revolutions of 72
samples, white noise of 2 % of the third order, a gain that changes by 0.5 % from one revolution to the next, and an
encoder whose zero is anywhere.

Run as: python measurements/make_rig.py
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import tripod_doe as td

TRUTH = {
    "groove_sliding_friction": 0.075,
    "needle_sliding_friction": 0.055,
    "initial_skew_1_deg": 0.4,
    "initial_skew_2_deg": -0.3,
}
OPERATING = ("joint_angle_deg", "torque_n_m", "speed_rpm")
POINTS = [
    (6, 100, 600), (8, 200, 900), (10, 300, 600), (12, 150, 1200),
    (14, 250, 400), (9, 60, 600), (11, 220, 800), (7, 150, 300),
]  # fmt: skip
REVOLUTIONS, SAMPLES, NOISE, GAIN = 8, 72, 0.02, 0.005


def orders(point: Mapping[str, Any]) -> np.ndarray:
    """Complex orders of a joint in N, shape (order,)."""
    answer = td.simulate(**point)
    return answer["thrust_amplitude"].values * np.exp(1j * np.radians(answer["thrust_phase_deg"].values))


def record(
    orders: np.ndarray, speed_rpm: float, zero_deg: float, random: np.random.Generator, samples: int = SAMPLES
) -> np.ndarray:
    """Time in s, angle of the encoder in deg and force in N of one record, shape (sample, 3)."""
    turned = np.arange(REVOLUTIONS * samples) * 360 / samples
    wave = sum((order * np.exp(1j * k * np.radians(turned + zero_deg))).real for k, order in enumerate(orders))
    gain = np.repeat(1 + GAIN * random.standard_normal(REVOLUTIONS), samples)
    force = gain * wave + NOISE * abs(orders[3]) * random.standard_normal(turned.size)
    return np.column_stack([turned / 6 / speed_rpm, turned, force])


def make_rig(folder: Path, truth: Mapping[str, float], model: str = "kinetostatic", seed: int = 0) -> None:
    """Write the records of a rig, and the table of their operating points."""
    folder.mkdir(parents=True, exist_ok=True)
    random, rows = np.random.default_rng(seed), []
    for number, values in enumerate(POINTS, start=1):
        point = dict(zip(OPERATING, map(float, values), strict=True))
        name = f"record_{number}.csv"
        wave = orders({"model": model, **truth, **point})
        table = record(wave, point["speed_rpm"], random.uniform(0, 360), random)
        lines = [f"{time:.5f},{angle:.1f},{force:.3f}" for time, angle, force in table]
        (folder / name).write_text("\n".join(["time_s,rotation_deg,thrust_n", *lines, ""]), encoding="utf-8")
        rows.append([name, *map(str, values)])
    with (folder / "records.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerows([["file", *OPERATING], *rows])


if __name__ == "__main__":
    make_rig(Path(__file__).with_name("rig"), TRUTH)
