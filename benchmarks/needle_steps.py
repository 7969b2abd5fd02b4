"""How exactly does kinetostatic follow its needles? Its orders beside those with 32 times as many steps.

    python benchmarks/needle_steps.py [--count 40] [--seed 3413] [--straight] [--ordinary]

Random joints of the field (field.py), with crowned needles or `--straight` ones, or the `--ordinary` joints of
ordinary_joints.py; joints whose balance is slow to settle are left out, since theirs is not the steps' error. Told are
errors of amplitudes in per cent (median, third quartile, nine in ten), the second order where it is above 0.5 % of the
third, and how often the step error that answers state holds them.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from field import all_columns, field_points
from ordinary_joints import drawn_joints

from tripod_doe.joint.massless_needles import load_sharing
from tripod_doe.joint.outputs import STEP_ERROR
from tripod_doe.joint.simulator import simulator

FINER = 32
SLOW = 60
"""Sweeps of a balance that is slow to settle."""
SMALL = 0.005
"""Second order over the third below which it does not count."""


def answered(columns: dict[str, np.ndarray], keep: tuple[str, ...] = ("thrust_amplitude",)):
    """Answers of kinetostatic, and CPU milliseconds a joint."""
    began = time.process_time()
    block = simulator.simulate(columns, keep)
    return block, 1e3 * (time.process_time() - began) / block.count


def tell(order: int, found: np.ndarray, finest: np.ndarray, stated: np.ndarray) -> None:
    """Print how far an order is off, and how often its stated error holds that."""
    off = np.abs(found - finest)
    told = ", ".join(f"{value:.2g}" for value in 100 * np.quantile(off / finest, [0.5, 0.75, 0.9]))
    print(f"order {order}: {told} % off at {off.size} joints; stated errors hold {100 * (off <= stated).mean():.0f} %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=3413)
    parser.add_argument("--straight", action="store_true")
    parser.add_argument("--ordinary", action="store_true")
    given = parser.parse_args()
    if given.ordinary:
        drawn = drawn_joints(given.count)
    else:
        drawn = field_points(given.count, np.random.default_rng(given.seed), "rollers")
        drawn["needle_crown_um"] *= not given.straight
    columns = all_columns(drawn) | {"model": np.full(given.count, "kinetostatic", object)}
    first = answered(columns)[0]  # compiles, too
    usual = np.isfinite(first.outputs["thrust_amplitude"].data[:, 3]) & (first.steps < SLOW)
    usual &= columns["joint_angle_deg"].astype(float) > 0
    columns = {name: column[usual] for name, column in columns.items()}
    plain, price = answered(columns)
    stated, more = answered(columns, ("thrust_amplitude", STEP_ERROR))
    load_sharing._LEAST_STEPS *= FINER
    found, finest = (block.outputs["thrust_amplitude"].data for block in (plain, answered(columns)[0]))
    error = stated.outputs[STEP_ERROR].data
    print(f"{usual.sum()} joints, {price:.1f} CPU-ms each, {more:.1f} with step errors")
    counts = finest[:, 2] > SMALL * finest[:, 3]
    tell(2, found[counts, 2], finest[counts, 2], error[counts, 2])
    tell(3, found[:, 3], finest[:, 3], error[:, 3])


if __name__ == "__main__":
    main()
