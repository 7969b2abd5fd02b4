"""How often the stated 95 % intervals of the balances' orders and phases hold the answer of `needles`, in drive or coast.

    python benchmarks/other_orders.py RECORD [--joints 40] [--coast] [--seed 1] [--model kinetostatic]

Joints are random: 2 to 15 deg, 20 to 300 N m, 200 to 1,500 rpm, groove friction 0.02 to 0.12, needle friction 0.01 to
0.1, skews of 0.5 deg standard deviation, pitch radius 18 to 26 mm. RECORD gets a line for each run of `needles` (3 to
10 CPU-s), which a second call reads. Each row of the table is an order: number of joints, share of amplitudes within
1.96 of their stated deviations (of the third order, within the stated limit, which nine of ten should keep), the
factor on all deviations with which 19 of 20 would be, and the same of phases.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from fit import HiddenOrders, make_rig

from tripod_doe.joint.known_errors.error_estimate import known_errors
from tripod_doe.joint.known_errors.other_orders import deviations_of_orders
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.simulator import simulator

RANGES = {
    "joint_angle_deg": (2, 15),
    "torque_n_m": (20, 300),
    "speed_rpm": (200, 1500),
    "groove_sliding_friction": (0.02, 0.12),
    "needle_sliding_friction": (0.01, 0.1),
    "pitch_radius_mm": (18, 26),
}
SKEW_DEG = 0.5


def drawn_joint(random: np.random.Generator, coast: bool) -> dict[str, float]:
    """A random joint at a random operating point."""
    joint = {name: float(random.uniform(*limits)) for name, limits in RANGES.items()}
    joint |= {f"initial_skew_{at}_deg": SKEW_DEG * float(random.standard_normal()) for at in (1, 2, 3)}
    return joint | {"torque_n_m": -joint["torque_n_m"] if coast else joint["torque_n_m"]}


def over_stated(joint: dict[str, float], needles: np.ndarray, model: str) -> np.ndarray:
    """Errors of amplitudes and phases over their stated deviations, shape (2, order); of the third over its limit."""
    own = joint | {"model": model}
    orders = make_rig.orders(own)
    amplitude, true = np.abs(orders), np.abs(needles)
    columns = simulator.columns(own, {}, 1)
    sizes, turned = (each[0] for each in deviations_of_orders(simulator, columns, amplitude[None]))
    sizes[3] = known_errors(model, columns)[1][0] * true[3]
    apart = np.abs(np.degrees(np.angle(orders * np.conj(needles))))
    return np.stack([np.abs(amplitude - true) / sizes, apart / turned])


def row_of(errors: np.ndarray, limit: float) -> str:
    """Joints, share within the limit, and the factor for 19 of 20."""
    known = errors[np.isfinite(errors)]
    if not known.size:
        return "   0      -       -"
    return f"{known.size:4d} {100 * np.mean(known <= limit):5.1f} % {np.quantile(known, 0.95) / limit:7.2f}"


def main() -> None:
    """Print one table of amplitudes and phases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", type=Path)
    parser.add_argument("--joints", type=int, default=40)
    parser.add_argument("--coast", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", default="kinetostatic")
    options = parser.parse_args()
    random = np.random.default_rng([options.seed, int(options.coast)])
    hidden, errors = HiddenOrders(options.record), []
    for joint in [drawn_joint(random, options.coast) for _ in range(options.joints)]:
        needles = hidden(joint | {"model": "needles"})
        if needles is not None:
            errors.append(over_stated(joint, needles, options.model))
    print("order   amplitudes: within, factor    phases: within, factor")
    for order in ORDERS[1:]:
        amplitudes, phases = np.array(errors)[:, :, order].T
        print(f"{order:5d}   {row_of(amplitudes, 1 if order == 3 else 1.96)}    {row_of(phases, 1.96)}")


if __name__ == "__main__":
    main()
