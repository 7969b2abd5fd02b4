"""Does a balance answer everywhere? Random points of the field in which a tripod joint is used: outcomes and prices.

    python benchmarks/field.py [equilibrium|kinetostatic] [--count 1000] [--seed 1] [--calm] [--against FACTOR]

Every point has operating conditions, frictions, skews and a geometry of its own, as far as the parts fit, and random
mechanisms switched off; every 25th is a straight joint. `--calm` stays near the paper's point instead: what the field
costs is compared with that. `--against 10` solves again with a tenth of the tolerance and tells how far the third order
moved, over the largest order of the thrust. Points that did not finish are listed as arguments of `simulate`.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

from tripod_doe.joint.feasibility import misfits
from tripod_doe.joint.models import MODELS
from tripod_doe.joint.parameters import JOINT_PARAMETERS, internal_values
from tripod_doe.joint.simulator import simulator
from tripod_doe.simulator import Outcome

FIELD = {
    "joint_angle_deg": (0.0, 25.0), "torque_n_m": (5.0, 500.0), "speed_rpm": (20.0, 3000.0),
    "groove_sliding_friction": (0.0, 0.2), "needle_sliding_friction": (0.0, 0.15),
    "groove_rolling_friction": (0.0, 0.006), "needle_rolling_friction": (0.0, 0.006), "transition_ratio": (0.05, 0.5),
    "initial_skew_1_deg": (-2.0, 2.0), "initial_skew_2_deg": (-2.0, 2.0), "initial_skew_3_deg": (-2.0, 2.0),
    "bearing_radial_clearance_mm": (0.0, 0.05),
}  # fmt: skip
"""Ranges of the field; torque of both signs."""
CALM = {"joint_angle_deg": (5.0, 15.0), "torque_n_m": (25.0, 150.0), "speed_rpm": (300.0, 1000.0)}
GEOMETRY = (
    "pitch_radius_mm", "roller_radius_mm", "roller_width_mm", "needle_count", "needle_diameter_mm", "needle_length_mm",
    "needle_pitch_diameter_mm", "shaft_mass_kg",
)  # fmt: skip
"""Within 25 % of their defaults."""
SWITCHES = [name for name, parameter in JOINT_PARAMETERS.items() if parameter.kind == "switch"]
STRAIGHT = 25
NO_THRUST = 1e-3
"""N; the orders of a straight joint are rounding."""
_BATCH = 1000


def field_points(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of random points whose parts fit."""
    chosen: dict[str, np.ndarray] = {}
    while len(next(iter(chosen.values()), ())) < count:
        drawn = {name: rng.uniform(*limits, _BATCH) for name, limits in FIELD.items()}
        drawn["torque_n_m"] *= rng.choice([-1, 1], _BATCH)
        drawn["joint_angle_deg"][::STRAIGHT] = 0.0
        for name in GEOMETRY:
            drawn[name] = JOINT_PARAMETERS[name].default * rng.uniform(0.75, 1.25, _BATCH)
        drawn["needle_count"] = np.round(drawn["needle_count"])
        drawn["groove_radius_ratio"] = 1 + 0.0086 * rng.uniform(0.75, 1.25, _BATCH)
        drawn |= {name: rng.integers(0, 2, _BATCH).astype(float) for name in SWITCHES}
        full = all_columns(drawn)
        fits = np.ones(_BATCH, bool)
        fits[[row for row, _ in misfits(internal(full))]] = False
        chosen = {name: np.concatenate([chosen.get(name, column[:0]), column[fits]]) for name, column in drawn.items()}
    return {name: column[:count] for name, column in chosen.items()}


def calm_points(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of random points near the paper's."""
    return {name: rng.uniform(*limits, count) for name, limits in CALM.items()}


def all_columns(drawn: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every parameter of the joint."""
    return simulator.columns({}, drawn, len(drawn["torque_n_m"]))


def internal(columns: dict[str, np.ndarray]):
    """Values of a block of points."""
    return internal_values({n: c for n, c in columns.items() if JOINT_PARAMETERS[n].kind != "choice"})


def answers(model: str, columns: dict[str, np.ndarray], factor: float = 1.0):
    """Outcome, reason, CPU milliseconds and complex orders of each point, by a model with a `factor` of its tolerance."""
    solver, default = MODELS[model], MODELS[model].methods["newton"]["relative_tolerance"]
    values = internal(
        all_columns(columns) | {"relative_tolerance": np.full(len(columns["torque_n_m"]), factor * default)}
    )
    solver.prepare(values.take([0]), "newton")
    keep, rows = ("thrust_amplitude", "thrust_phase_deg"), []
    for i in range(values.torque.size):
        began = time.process_time()
        block = solver.simulate(values.take([i]), "newton", 360, keep)
        milliseconds = 1e3 * (time.process_time() - began)
        amplitude, phase = (block.outputs[name].data[0] for name in keep)
        rows.append((int(block.outcome[0]), block.detail[0], milliseconds, amplitude * np.exp(1j * np.radians(phase))))
    outcome, detail, price, orders = zip(*rows, strict=True)
    return np.array(outcome), detail, np.array(price), np.array(orders)


def tell(columns: dict[str, np.ndarray], outcome: np.ndarray, detail, price: np.ndarray, listed: int) -> None:
    """Print outcomes with their reasons, prices, and some points that did not finish."""
    for (number, text), times in Counter(zip(outcome.tolist(), detail, strict=True)).most_common():
        print(f"{times:6d} {100 * times / outcome.size:7.3f} %  {Outcome(number).label}  {text}")
    low, middle, high = np.quantile(price, (0.25, 0.5, 0.75))
    print(f"price: median {middle:.2f} ms ({low:.2f} to {high:.2f}), mean {price.mean():.2f}, "
          f"largest {price.max():.1f} ms, {price.max() / middle:.0f} medians")  # fmt: skip
    for row in np.flatnonzero(outcome != Outcome.FINISHED)[:listed]:
        print(" ", " ".join(f"--{name} {column[row]:.17g}" for name, column in columns.items()))


def moved(orders: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Largest change of any order of each point, over the largest order."""
    return np.abs(orders - reference).max(axis=1) / np.maximum(np.abs(reference).max(axis=1), NO_THRUST)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="kinetostatic", choices=("equilibrium", "kinetostatic"))
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true")
    parser.add_argument("--against", type=float, metavar="FACTOR")
    parser.add_argument("--listed", type=int, default=3)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    columns = (calm_points if arguments.calm else field_points)(arguments.count, rng)
    outcome, detail, price, orders = answers(arguments.model, columns)
    tell(columns, outcome, detail, price, arguments.listed)
    if arguments.against:
        tight, _, _, reference = answers(arguments.model, columns, 1 / arguments.against)
        both = (outcome == Outcome.FINISHED) & (tight == Outcome.FINISHED)
        change = moved(orders[both], reference[both])
        print(f"against a tolerance {arguments.against:g} times smaller, {both.sum()} points: median change of an order "
              f"{np.median(change):.1e} of the largest, worst {change.max():.1e}")  # fmt: skip


if __name__ == "__main__":
    main()
