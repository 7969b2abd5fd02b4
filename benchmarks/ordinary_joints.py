"""Limits that kinetostatic states of 2,000 ordinary joints, what asking for vibrations costs, and whether limits hold.

    python benchmarks/ordinary_joints.py [--count 2000] [--held 0] [--first 0]

The joints fill 3 to 14 deg, 20 to 300 N m, 200 to 1,500 rpm, groove friction 0.02 to 0.08 and one skew of up to 1 deg
evenly. With `--held 50` 50 of them, from `--first` on, are run with `needles`, too (8 to 24 CPU-s each): a limit holds
where the difference is no larger, or no larger together with the numerical error that `needles` state.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.stats import qmc

import tripod_doe as td
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.simulator import simulator

ORDINARY = {
    "joint_angle_deg": (3, 14),
    "torque_n_m": (20, 300),
    "speed_rpm": (200, 1500),
    "groove_sliding_friction": (0.02, 0.08),
    "initial_skew_1_deg": (-1, 1),
}
ALL = 2000


def drawn_joints(count: int) -> dict[str, np.ndarray]:
    """Columns of the first of all ordinary joints."""
    low, high = np.transpose(list(ORDINARY.values()))
    unit = qmc.LatinHypercube(len(ORDINARY), rng=np.random.default_rng(34)).random(ALL)[:count]
    return dict(zip(ORDINARY, qmc.scale(unit, low, high).T, strict=True))


def stated_limits(drawn: dict[str, np.ndarray]) -> np.ndarray:
    """Limits with and without a look at vibrations, told with the price of each; those with it, shape (joint,)."""
    count = len(drawn["torque_n_m"])
    columns = {name: parameter.column([parameter.default] * count) for name, parameter in JOINT_PARAMETERS.items()}
    columns |= drawn | {"model": np.full(count, "kinetostatic", object)}
    first = {name: column[:1] for name, column in columns.items()}
    simulator.simulate(first, ["thrust_amplitude", "vibration_growth"])  # compiles
    for keep in (["thrust_amplitude"], ["thrust_amplitude", "vibrates"]):
        began = time.process_time()
        outputs = {name: values.data for name, values in simulator.simulate(columns, keep).outputs.items()}
        price = 1e3 * (time.process_time() - began) / count
        limit = simulator.model_errors(columns, outputs).limit
        vibrates = outputs.get("vibrates", np.full(count, np.nan))
        median, decile = 100 * np.nanquantile(limit, [0.5, 0.9])
        print(
            f"{' and '.join(keep)}: {price:.2f} CPU-ms a joint; limits {median:.2g} % in the median, {decile:.2g} % at nine "
            f"in ten; {np.isfinite(vibrates).sum()} looked at for vibrations, {np.nansum(vibrates):.0f} vibrate"
        )
    return limit


def held(drawn: dict[str, np.ndarray], limit: np.ndarray, rows: range) -> None:
    """Print for each of these joints whether its limit holds against `needles`, then at how many it does."""
    plainly = with_error = 0
    for row in rows:
        point = {name: float(column[row]) for name, column in drawn.items()}
        near, exact = td.simulate(**point), td.simulate(**point, model="needles", accuracy=0.002)
        third, truth = (float(each["thrust_amplitude"].sel(order=3)) for each in (near, exact))
        off, error = abs(third / truth - 1), float(exact["thrust_amplitude_error"].sel(order=3)) / truth
        plainly, with_error = plainly + (off <= limit[row]), with_error + (off <= limit[row] + error)
        print(
            f"joint {row}: {100 * off:.3g} % from needles, whose error is {100 * error:.2g} %; "
            f"limit {100 * limit[row]:.2g} %",
            flush=True,
        )
    print(f"limits hold at {plainly} of {len(rows)} joints, and at {with_error} with the numerical error of needles")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=ALL)
    parser.add_argument("--held", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    drawn = drawn_joints(arguments.count)
    limit = stated_limits(drawn)
    if arguments.held:
        held(drawn, limit, range(arguments.first, arguments.first + arguments.held))


if __name__ == "__main__":
    main()
