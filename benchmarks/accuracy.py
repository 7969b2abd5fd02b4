"""Is the error that a run reports its true one, and what does a run cost that finds its tolerance itself?

    python benchmarks/accuracy.py [rollers|needles] [--points 60] [--seed 1] [--accuracy 0.02] [--finer 8]

Random operating points of the field in which a joint is used. Each is refined to the accuracy; the truth is a run of
all revolutions from the start, those included in which the joint swings in, with a tolerance that is `--finer` times
smaller than the one that was found; orders are means of the same revolutions. Told are
the reported error over the true one, of the complex third order and of its amplitude, and the price beside that of a
fixed tolerance: of the coarsest one found, with which most points miss, and of the finest one, which the worst point
needs. Points in which a vibration grows are counted and left out: they are followed with it (`joint.vibration.vibration_effect`).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.models.multibody_run import run_limits
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.passes import FollowedJoint, Motion
from tripod_doe.joint.multibody.refinement import first_tolerance, refine
from tripod_doe.joint.multibody.run_result import StoppedError, Wanted
from tripod_doe.joint.multibody.sampled_signals import sampled_signals
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.registry import METHODS

FIELD = {
    "joint_angle_deg": (0.5, 20.0),
    "torque_n_m": (5.0, 500.0),
    "speed_rpm": (20.0, 3000.0),
    "groove_sliding_friction": (0.0, 0.2),
    "needle_sliding_friction": (0.0, 0.15),
    "groove_rolling_friction": (0.0, 0.006),
    "needle_rolling_friction": (0.0, 0.006),
    "transition_ratio": (0.05, 0.5),
    "initial_skew_1_deg": (-2.0, 2.0),
    "initial_skew_2_deg": (-2.0, 2.0),
    "initial_skew_3_deg": (-2.0, 2.0),
    "bearing_radial_clearance_mm": (0.0, 0.05),
}
"""Ranges of the field; torque of both signs."""
METHOD = METHODS["adaptive-euler"]
SAMPLES = 360
REVOLUTIONS_OF_GIVEN = 4 + 2 * 7 / 6
"""Revolutions that a run with a given tolerance takes, those of its error with half the steps."""


@dataclass(frozen=True)
class Trial:
    """A point: whether its accuracy was met, errors over its third order (of the amplitude, complex, reported), tolerance
    and force evaluations, and those of a sample with it."""

    met: bool
    of_amplitude: float
    true: float
    reported: float
    tolerance: float
    evaluations: int
    per_sample: float


def draw_point(rng: np.random.Generator) -> JointValues[float]:
    """A random operating point of the reference joint."""
    given = {name: float(rng.uniform(*limits)) for name, limits in FIELD.items()}
    given["torque_n_m"] *= rng.choice([-1, 1])
    return point_values(given).point(0)


def joint_of(values: JointValues[float], needles: bool, samples: int) -> FollowedJoint:
    assembly = assemble(build_joint(values, needles))
    return FollowedJoint(assembly, values, METHOD, samples, run_limits(values, 1, METHOD.name))


def orders_of(joint: FollowedJoint, motion: Motion) -> np.ndarray:
    """Complex orders of the thrust, extrapolated where runs do so, means over the sampled revolutions, shape (order,)."""
    signals = sampled_signals(motion, joint.values, Wanted(joint.samples))
    return complex_amplitudes(signals.groove_thrust.sum(1)).mean(0)


def trial(values: JointValues[float], needles: bool, accuracy: float, finer: float, samples: int) -> Trial | None:
    """Refine a point and hold it against its truth; None where it stops on its way."""
    wanted, joint = OrderAccuracy({3: accuracy}), joint_of(values, needles, samples)
    motion = refine(joint, wanted, first_tolerance(wanted, needles))
    if not motion.sampled:
        return None
    per_sample = motion.runs[-1].force_evaluations / (motion.runs[-1].times.size - 1)
    orders = orders_of(joint, motion)
    found = orders[3]
    sampled = max(motion.sampled, 2)
    cycles = round((motion.result.times.size - 1) / samples) - sampled + 2
    same = joint_of(replace(values, cycles=cycles), needles, samples)
    try:
        true = same.first(motion.setting / finer)
        true = same.longer(true, sampled) if sampled > len(true.orders) else true
    except StoppedError:
        return None
    truth = true.orders.mean(0)[3]
    size = float(wanted.sizes(np.abs(orders), values)[3])
    return Trial(
        not motion.missed,
        abs(abs(found) - abs(truth)) / size,
        abs(found - truth) / size,
        motion.error[3] / size,
        motion.setting,
        sum(run.force_evaluations for run in motion.runs),
        per_sample,
    )


def fixed_price(trials: list[Trial], tolerance: float, samples: int) -> float:
    """Mean force evaluations of runs with this tolerance: steps cost as much as in the run's own last pass."""
    return float(np.mean([t.per_sample * t.tolerance / tolerance for t in trials])) * samples * REVOLUTIONS_OF_GIVEN


def tell(trials: list[Trial], samples: int) -> None:
    """Print reported errors against true ones, and prices."""
    reported, true, amplitude = (
        np.array([getattr(t, n) for t in trials]) for n in ("reported", "true", "of_amplitude")
    )
    print(f"{sum(t.met for t in trials)} of {len(trials)} points are as accurate as asked")
    for name, errors in (("complex third order", true), ("its amplitude", amplitude)):
        share, ratio = 100 * np.mean(reported >= errors / 2), np.median(reported / np.maximum(errors, 1e-12))
        print(f"{name}: reported error at least half the true one at {share:.0f} %, {ratio:.2f} times it in the median")
    price, tolerances = np.mean([t.evaluations for t in trials]), [t.tolerance for t in trials]
    print(
        f"force evaluations: mean {price:.0f}; with {max(tolerances):.2g} at every point "
        f"{fixed_price(trials, max(tolerances), samples):.0f}, with {min(tolerances):.2g} "
        f"{fixed_price(trials, min(tolerances), samples):.0f}"
    )


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="rollers", choices=("rollers", "needles"))
    parser.add_argument("--points", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--accuracy", type=float, default=0.02)
    parser.add_argument("--finer", type=float, default=8.0)
    parser.add_argument("--samples", type=int, default=SAMPLES)
    given = parser.parse_args(arguments)
    rng, trials, vibrating, stopped = np.random.default_rng(given.seed), [], 0, 0
    while len(trials) + stopped < given.points:
        values = draw_point(rng)
        if growing_vibration(values):
            vibrating += 1
        elif (one := trial(values, given.model == "needles", given.accuracy, given.finer, given.samples)) is None:
            stopped += 1
        else:
            trials.append(one)
            print(f"{len(trials)}: {one}", flush=True)
    print(f"{vibrating} more points vibrate, {stopped} stopped on their way")
    tell(trials, given.samples)


if __name__ == "__main__":
    main()
