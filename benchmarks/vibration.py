"""Is a vibration followed right? Joints that vibrate by themselves, each followed by methods that share only the forces.

    python benchmarks/vibration.py [--revolutions 12] [--points 5]

For each joint and method: mean third order over the later two thirds of the revolutions, twice the standard deviation
of that mean, effective value of the thrust above order 12, and force evaluations and CPU time per revolution. Where
chance does not explain what methods are apart, steps do. The step of the fixed-step methods turns the phase
of the vibration by 0.1; an answer of the service takes Rosenbrock's method (`joint.vibration.vibrating_run`).
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.order_noise import mean_and_chance
from tripod_doe.joint.multibody.revolutions import RevolvingJoint
from tripod_doe.joint.multibody.run_result import Wanted
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Limits

POINTS = (
    {"torque_n_m": 25, "groove_sliding_friction": 0.1},
    {"torque_n_m": 5, "speed_rpm": 300},
    {"joint_angle_deg": 17, "speed_rpm": 1500, "torque_n_m": -300, "groove_sliding_friction": 0.15},
    {"joint_angle_deg": 14, "speed_rpm": 1800, "torque_n_m": 100, "groove_sliding_friction": 0.16},
    {"joint_angle_deg": 9, "speed_rpm": 1200, "torque_n_m": 57, "groove_sliding_friction": 0.18},
)
"""Operating points of the reference joint, dry (0.001 s/mm), one of little friction; torque of both signs."""
PHASE = 0.1
LIMITS = Limits(energy=math.inf, reversals=1.0, drift=1e-2, windows=0)


def follow(point: dict[str, float], method: str, setting: float, revolutions: int) -> tuple[float, float]:
    """Mean third order of a joint followed by a method, and how far chance may move it; prints both."""
    values = point_values({"relative_tolerance": 4e-3, "contact_damping_s_per_mm": 0.001, **point}).point(0)
    joint = RevolvingJoint(
        assemble(build_joint(values, needles=False)), values, METHODS[method], Wanted(60), LIMITS, 10**9
    )
    begun = time.process_time()
    turns = joint.follow(revolutions, setting)[revolutions // 3 :]
    mean, chance = mean_and_chance(np.array([turn.thirds for turn in turns]))
    third, unsure = float(abs(mean[3])), float(chance[3])
    print(
        f"  {method:20s} {setting:8.2g}  third order {third:8.3f} +- {unsure:.3f} N  above order 12 "
        f"{np.mean([turn.unrest for turn in turns]):7.2f} N  {joint.force_evaluations / revolutions:8.0f} evaluations, "
        f"{(time.process_time() - begun) / revolutions:.2f} s a revolution",
        flush=True,
    )
    return third, unsure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--revolutions", type=int, default=12)
    parser.add_argument("--points", type=int, default=len(POINTS))
    arguments = parser.parse_args()
    for point in POINTS[: arguments.points]:
        found = growing_vibration(
            point_values({"relative_tolerance": 4e-3, "contact_damping_s_per_mm": 0.001, **point}).point(0)
        )
        print(" ".join(f"--{name} {value}" for name, value in point.items()))
        if found is None:
            print("  does not vibrate")
            continue
        print(f"  {found.described}; third order without it {found.third:.3f} N")
        step = PHASE / found.growth.frequency
        ways = (("rosenbrock", 1e-3), ("generalized-alpha", step), ("bdf2", step))
        means = [follow(point, method, setting, arguments.revolutions) for method, setting in ways]
        for third, unsure in means[1:]:
            apart, chance = abs(third - means[0][0]), math.hypot(unsure, means[0][1])
            print(
                f"  apart from the first: {100 * apart / third:.2f} %, of which chance explains {100 * chance / third:.2f} %"
            )


if __name__ == "__main__":
    main()
