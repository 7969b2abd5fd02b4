"""Do runs know when they fail? Random runs against the truth: how many wrong ones finish, how many good ones are refused.

    python benchmarks/guards.py [cheap|rollers|needles] [--count 400] [--points 12] [--settings 5] [--seed 1] [--field]

A run is wrong if its quantity is off by more than 5 %, good if by less than 1 %. A miss is a wrong run that is called
finished, a false alarm a good run that is not. A run that stopped on its way is wrong. Upper bounds are Clopper and
Pearson's at 95 %, over all runs and over the wrong ones. A cube keeps no numbers of refused runs, so that this is no study.

Cheap scenes, each run with its own truth, and steps or tolerances of which many are too coarse:

    needle   between two plates: axial drift; truth by rosenbrock at 1e-7, held against the closed form to 10 %
    groove   roller set down in its groove without spin, for half to four times as long as it needs to roll: axial
             force, mean over 20 samples; truth by rosenbrock at 1e-8; steps up to a twentieth of the duration
    thrown   a ball that slides, then rolls, for half to four times as long as it slides: place, and turn times radius,
             over its slip path; truth by rosenbrock at 1e-9; steps up to a fifth of the duration
    dropped  a ball that bounces: height; truth is the height that it fell from

The joint: random operating points near the paper's, or with `--field` of the whole field (field.py), each with several
random methods and settings, the third order of the thrust, and the second where it is above 1 % of the third. The
second counts as called good where its reported error is below 5 %. The truth of a point is adaptive-euler at 2.5e-4.
For rollers generalized-alpha at 1e-5 s, which damps little, must agree with it to 1 % and pass its own checks (where an
iteration of it does not converge, as at steep transitions, bdf2 at this step): else the joint vibrates by itself there, which the damping of implicit Euler hides at any affordable tolerance and
`joint.vibration.growing_vibration` has to notice. The undamped run is the truth then; such points have rows of their own. No run counts
as good where the truth itself reports an error above 1 %, as it does where it rattles: nobody knows whether it is. Four
revolutions are short for a vibration that grows slowly: where growth is 1.1 to 1.3 a revolution, both truths may still
be smooth, and a run refused for it, or vibrating already, is right.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "mechanics" / "scenes"))
from example_scenes import dropped_ball, rolling_sphere
from field import field_points, upper_bound

from tripod_doe.joint.models.multibody_run import run_joint
from tripod_doe.joint.multibody.run_result import JointRun, Wanted
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Run, run
from tripod_doe.mechanics.scenes import needle_between_plates, roller_in_groove
from tripod_doe.mechanics.scenes.scene_simulator import SceneSimulator
from tripod_doe.model_interface import Outcome

WRONG, GOOD = 0.05, 0.01
TIMES = 0.5, 4.0
LARGEST_STEPS = 50_000
BUDGET = 1_000_000


@dataclass(frozen=True)
class Trial:
    """One run: what it was, how far off it is, whether it was called finished, and whether its truth is known to 1 %."""

    scene: str
    method: str
    error: float
    finished: bool
    text: str
    known: bool = True

    @property
    def wrong(self) -> bool:
        return not self.error <= WRONG

    @property
    def good(self) -> bool:
        return self.known and self.error < GOOD


@dataclass(frozen=True)
class CheapScene:
    """A scene: how an operating point is drawn, how it is run to an error, and steps or tolerances to draw from."""

    draw: Callable[[np.random.Generator], dict[str, float]]
    simulate: Callable[[Mapping[str, float], str, float], tuple[Run, float]]
    explicit: tuple[float, float]
    implicit: tuple[float, float]
    controlled: tuple[float, float]

    def settings(self, method: str) -> tuple[float, float]:
        """Range of steps, or of tolerances."""
        kind = METHODS[method]
        return self.controlled if kind.controlled else self.explicit if kind.explicit else self.implicit


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(*np.log([low, high]))))


def simulator_run(
    scene: SceneSimulator, values: Mapping[str, float], method: str, setting: float
) -> tuple[Run, dict[str, float]]:
    """A point of a scene, with the values that it was run with."""
    name = "relative_tolerance" if METHODS[method].controlled else "step_s"
    full = scene.effective({"method": method, **values, name: setting})
    numbers = {name: float(value) for name, value in full.items() if isinstance(value, int | float)}
    settings = Settings(tolerance=numbers.get("relative_tolerance", setting), budget=BUDGET)
    return scene.run(numbers, method, None if METHODS[method].controlled else setting, settings), numbers


def draw_needle(rng: np.random.Generator) -> dict[str, float]:
    friction = rng.uniform(0.01, 0.1, 2)
    while not max(friction) / min(friction) > 1.05:  # equal friction has no drift to be relative to
        friction = rng.uniform(0.01, 0.1, 2)
    return {
        "friction_a": friction[0],
        "friction_b": friction[1],
        "plate_speed_mm_s": log_uniform(rng, 10, 1000),
        "skew_deg": rng.choice([-1, 1]) * rng.uniform(0.3, 10),
        "load_n": log_uniform(rng, 10, 500),
    }


def run_needle(values: Mapping[str, float], method: str, setting: float) -> tuple[Run, float]:
    duration = 0.01 if METHODS[method].controlled else min(0.02, setting * LARGEST_STEPS)
    values = {**values, "duration_s": duration}
    result, numbers = simulator_run(needle_between_plates.simulator, values, method, setting)
    reference, _ = simulator_run(needle_between_plates.simulator, values, "rosenbrock", 1e-7)
    truth = reference.positions[-1, 1, 1]
    # short runs hold the start: settling takes some per cent of their drift, tilting the needle up to 0.1 um
    apart, formula = (
        truth - needle_between_plates.closed_form(numbers)[1],
        needle_between_plates.closed_form(numbers)[1],
    )
    if reference.outcome != Outcome.FINISHED or abs(apart) > 0.1 * abs(formula) + 1e-4:
        raise SystemExit(f"no truth for {values}: {truth} against {formula}, {reference.detail}")
    return result, abs(result.positions[-1, 1, 1] / truth - 1)


def draw_groove(rng: np.random.Generator) -> dict[str, float]:
    return {
        "tilt_deg": rng.uniform(2, 15),
        "axial_speed_mm_s": log_uniform(rng, 20, 500),
        "load_n": log_uniform(rng, 50, 2e3),
        "friction": rng.uniform(0.02, 0.1),
        "transition_ratio": log_uniform(rng, 0.05, 0.5),
        "times": log_uniform(rng, *TIMES),
    }


def run_groove(values: Mapping[str, float], method: str, setting: float) -> tuple[Run, float]:
    full = roller_in_groove.simulator.effective(dict(values))
    numbers = {name: float(value) for name, value in full.items() if isinstance(value, int | float)}
    roller = roller_in_groove.build(numbers).bodies[0]
    spun_up = (
        roller.inertia[1]
        * numbers["axial_speed_mm_s"]
        / (numbers["roller_radius_mm"] ** 2 * numbers["friction"] * numbers["load_n"])
    )
    numbers["duration_s"] = values["times"] * spun_up
    scene = roller_in_groove.build(numbers)
    assembly = assemble(replace(scene, bodies=(replace(roller, angular_velocity=(0.0, 0.0, 0.0)),)))
    truth = run(assembly, "rosenbrock", numbers["duration_s"], samples=20, settings=Settings(tolerance=1e-8))
    if truth.outcome != Outcome.FINISHED:
        raise SystemExit(f"no truth for {values}: {truth.detail}")
    result = part_run(assembly, numbers["duration_s"], 20, method, setting)
    forces = [axial_force(each, numbers) for each in (result, truth)]
    return result, abs(forces[0] / forces[1] - 1)


def axial_force(result: Run, numbers: Mapping[str, float]) -> float:
    """Axial force on the groove, mean over the samples but the first."""
    states = [
        replace(result, positions=p[None], velocities=v[None])
        for p, v in zip(result.positions[1:], result.velocities[1:], strict=True)
    ]
    return float(np.mean([roller_in_groove.simulator.answer(numbers, state)["axial_force_n"] for state in states]))


def part_run(assembly, duration: float, samples: int, method: str, setting: float) -> Run:
    """A run whose step, if it has one, is a part of its duration."""
    controlled = METHODS[method].controlled
    settings = Settings(tolerance=setting if controlled else 1e-6, budget=BUDGET)
    step = None if controlled else setting * duration
    return run(assembly, method, duration, step=step, samples=samples, settings=settings)


def draw_thrown(rng: np.random.Generator) -> dict[str, float]:
    return {
        "friction": rng.uniform(0.1, 0.4),
        "transition": log_uniform(rng, 1e-4, 1e-2),
        "times": log_uniform(rng, *TIMES),
    }


def run_thrown(values: Mapping[str, float], method: str, setting: float) -> tuple[Run, float]:
    assembly = assemble(rolling_sphere(values["friction"], values["transition"]))
    slides = 2 / 7 / (values["friction"] * 9.81)  # from 1 m/s, until it rolls
    duration = values["times"] * slides
    truth = run(assembly, "rosenbrock", duration, samples=5, settings=Settings(tolerance=1e-9)).positions[-1, 1]
    result = part_run(assembly, duration, 5, method, setting)
    found, part, radius = result.positions[-1, 1], min(values["times"], 1.0), 0.1
    turn = 2 * np.arccos(min(abs(found[3:] @ truth[3:]), 1.0))
    return result, max(abs(found[0] - truth[0]), radius * turn) / (slides * (part - part * part / 2))


def draw_dropped(rng: np.random.Generator) -> dict[str, float]:
    return {"height": log_uniform(rng, 0.01, 0.2), "stiffness": log_uniform(rng, 3e6, 3e8)}


def run_dropped(values: Mapping[str, float], method: str, setting: float) -> tuple[Run, float]:
    scene, duration, _ = dropped_ball(**values)
    result = part_run(assemble(scene), duration, 20, method, setting / duration)
    return result, abs((result.positions[-1, 1, 2] - 0.1) / values["height"] - 1)


CHEAP = {
    "needle": CheapScene(draw_needle, run_needle, (2e-9, 1e-6), (3e-7, 1e-3), (1e-7, 1e-1)),
    "groove": CheapScene(draw_groove, run_groove, (1e-4, 5e-2), (1e-3, 5e-2), (1e-7, 1e-1)),  # parts of the duration
    "thrown": CheapScene(draw_thrown, run_thrown, (1e-4, 2e-1), (1e-3, 2e-1), (1e-7, 1e-1)),
    "dropped": CheapScene(draw_dropped, run_dropped, (5e-6, 1e-2), (3e-6, 1e-2), (1e-7, 1e-1)),
}


def cheap_trials(count: int, rng: np.random.Generator):
    """Random runs of the cheap scenes, one scene after the other."""
    for number in range(count):
        name = list(CHEAP)[number % len(CHEAP)]
        scene = CHEAP[name]
        # at the pace of a scene without one's own: adaptive-euler belongs to the joint
        method = str(rng.choice([m for m in METHODS if m != "adaptive-euler"]))
        values, setting = scene.draw(rng), log_uniform(rng, *scene.settings(method))
        result, error = scene.simulate(values, method, setting)
        if result.outcome not in (Outcome.FINISHED, Outcome.INACCURATE) or not np.isfinite(error):
            error = np.inf
        text = (
            f"{number} {name} {method} {setting:.3g} { ({n: float(f'{v:.4g}') for n, v in values.items()}) } error {error:.3g} energy "
            f"{result.energy_residual:.2g} reversals {result.reversals:.2g} halved step {result.disagreement:.2g} "
            f"steps {result.steps}: "
            f"{result.outcome.label} {result.detail}"
        )
        yield Trial(name, method, error, result.outcome == Outcome.FINISHED, text)


UNDAMPED = ("generalized-alpha", "bdf2")
"""Methods that damp little, in the order in which they are asked for the truth."""
ROLLERS = {
    "adaptive-euler": (1e-3, 0.1),
    "linearly-implicit-euler": (5e-6, 3e-4),
    "implicit-euler": (3e-5, 1e-3),
    "bdf2": (3e-5, 1e-3),
    "generalized-alpha": (3e-5, 1e-3),
    "rosenbrock": (1e-4, 0.1),
    "symplectic-euler": (1.5e-6, 1e-5),
    "rk4": (3e-6, 2e-5),
}
NEEDLES = {
    "adaptive-euler": (1e-3, 0.1),
    "linearly-implicit-euler": (1e-5, 3e-4),
    "implicit-euler": (2e-5, 1e-3),
    "bdf2": (2e-5, 1e-3),
    "generalized-alpha": (2e-5, 1e-3),
}
FEW = {"needle_count": 9, "needle_diameter_mm": 5.89, "spheres_per_needle": 3}
SAMPLES = 180


def draw_point(rng: np.random.Generator, needles: bool) -> dict[str, float]:
    """An operating point; with needles, every third one of the full number of them."""
    skews = {f"initial_skew_{k}_deg": rng.uniform(-0.6, 0.6) for k in (1, 2, 3)}
    return {
        "joint_angle_deg": rng.uniform(2, 15),
        "torque_n_m": log_uniform(rng, 10, 100),
        "speed_rpm": rng.uniform(300, 1200),
        **skews,
        "groove_sliding_friction": rng.uniform(0.02, 0.1),
        "needle_sliding_friction": rng.uniform(0.01, 0.06),
        "bearing_radial_clearance_mm": rng.choice([rng.uniform(-0.003, 0), rng.uniform(0, 0.03), rng.uniform(0, 0.03)]),
        **(FEW if needles and rng.uniform() < 2 / 3 else {}),
    }


def draw_points(points: int, needles: bool, whole_field: bool, rng: np.random.Generator) -> list[dict[str, float]]:
    """Operating points; those of the field have a geometry of their own, and none is straight."""
    if not whole_field:
        return [draw_point(rng, needles) for _ in range(points)]
    columns = field_points(2 * points, rng, "needles" if needles else "rollers")
    bent = np.flatnonzero(columns["joint_angle_deg"])[:points]
    return [{name: float(column[row]) for name, column in columns.items()} for row in bent]


def joint_run(values: JointValues[float], needles: bool, method: str, setting: float):
    """A run and its amplitudes of orders 2 and 3, NaN if it stopped on its way."""
    step, tolerance = (np.nan, setting) if METHODS[method].controlled else (setting, np.nan)
    result = run_joint(replace(values, step=step, relative_tolerance=tolerance), needles, method, Wanted(SAMPLES))
    if result.readings is None:
        return result, np.full(2, np.nan)
    return result, np.abs(complex_amplitudes(result.readings.groove_thrust.sum(1)).mean(0))[2:4]


def reported_error(result: JointRun, found: np.ndarray) -> np.ndarray:
    """What a run says that its orders 2 and 3 are off by, NaN if it stopped on its way."""
    return np.full(2, np.nan) if result.readings is None else result.readings.amplitude_error[2:4] / found


def joint_truth(values: JointValues[float], needles: bool) -> tuple[np.ndarray, np.ndarray, str]:
    """Amplitudes of orders 2 and 3 of a point, whether they are known, and what its rows are to be called besides."""
    result, truth = joint_run(values, needles, "adaptive-euler", 2.5e-4)
    error, besides = reported_error(result, truth), ""
    print(f"  truth {truth} reported {error} {result.detail}", flush=True)
    if not needles:
        for method in UNDAMPED:
            other, undamped = joint_run(values, needles, method, 1e-5)
            if not np.isnan(undamped).any():
                break
        undamped_error = reported_error(other, undamped)
        print(f"  undamped {undamped} reported {undamped_error} {other.detail}", flush=True)
        if other.outcome != Outcome.FINISHED or not np.abs(undamped / truth - 1)[1] < GOOD:
            truth, error, besides = undamped, undamped_error, ", vibrating"
    return truth, error < GOOD, besides


def joint_trials(points: list[dict[str, float]], settings: int, needles: bool, rng: np.random.Generator):
    """Random settings at operating points: trials of the third and of the second order."""
    for number, point in enumerate(points):
        values, ranges = point_values({"relative_tolerance": 1e-3, **point}).point(0), NEEDLES if needles else ROLLERS
        print({name: float(f"{value:.4g}") for name, value in point.items()})
        truth, known, besides = joint_truth(values, needles)
        for each in range(settings):
            method = "adaptive-euler" if each == 0 else str(rng.choice(list(ranges)))
            setting = log_uniform(rng, *ranges[method])
            if method == "symplectic-euler" or method == "rk4":  # one revolution is dropped instead of two
                values = replace(values, cycles=3.0)
            result, found = joint_run(values, needles, method, setting)
            error = np.nan_to_num(np.abs(found / truth - 1), nan=np.inf)
            reported = reported_error(result, found)
            text = (
                f"{number} {method} {setting:.3g} second {error[0]:.3g} (reported {reported[0]:.2g}) third {error[1]:.3g} "
                f"(reported {reported[1]:.2g}): {result.outcome.label} {result.detail}"
            )
            print("   ", text, flush=True)
            finished = result.outcome == Outcome.FINISHED
            yield Trial(f"third order{besides}", method, error[1], finished, text, bool(known[1]))
            if truth[0] > 0.01 * truth[1]:
                called = finished and bool(reported[0] <= WRONG)
                yield Trial(f"second order{besides}", method, error[0], called, text, bool(known[0]))


def tell(trials: list[Trial]) -> None:
    """Tables by scene and by scene and method; then every miss and false alarm."""
    print(f"{'':42s} runs  wrong  misses  bound over runs, wrong   good  false alarms")
    for name in dict.fromkeys(trial.scene for trial in trials):
        of_scene = [trial for trial in trials if trial.scene == name]
        for method in ("", *sorted({trial.method for trial in of_scene})):
            chosen = [trial for trial in of_scene if method in ("", trial.method)]
            wrong, good = [t for t in chosen if t.wrong], [t for t in chosen if t.good]
            misses, alarms = sum(t.finished for t in wrong), sum(not t.finished for t in good)
            bounds = [100 * upper_bound(misses, n) for n in (len(chosen), len(wrong))] if wrong else [np.nan, np.nan]
            print(
                f"{name + ' ' + method:42s} {len(chosen):4d}  {len(wrong):5d}  {misses:6d}  {bounds[0]:7.2f} % {bounds[1]:7.2f} % "
                f"  {len(good):4d}  {alarms:6d}"
            )
    wrong, good = [trial for trial in trials if trial.wrong], [trial for trial in trials if trial.good]
    misses, alarms = [t for t in wrong if t.finished], [t for t in good if not t.finished]
    print(
        f"misses: {len(misses)} of {len(trials)} runs, {len(wrong)} wrong ones; below "
        f"{100 * upper_bound(len(misses), len(trials)):.2f} % of the runs, "
        f"{100 * upper_bound(len(misses), len(wrong)):.2f} % of the wrong ones"
    )
    print(
        f"false alarms: {len(alarms)} of {len(good)} good runs, {100 * len(alarms) / max(len(good), 1):.1f} %; "
        f"below {100 * upper_bound(len(alarms), len(good)):.1f} %"
    )
    for title, chosen in (("MISSES", misses), ("FALSE ALARMS", alarms)):
        print("\n".join([title, *(trial.text for trial in chosen)]) if chosen else f"no {title.lower()}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", nargs="?", default="cheap", choices=("cheap", "rollers", "needles"))
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--points", type=int, default=12)
    parser.add_argument("--settings", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--field", action="store_true")
    arguments = parser.parse_args()
    rng, begun = np.random.default_rng(arguments.seed), time.process_time()
    if arguments.kind == "cheap":
        trials = list(cheap_trials(arguments.count, rng))
    else:
        needles = arguments.kind == "needles"
        points = draw_points(arguments.points, needles, arguments.field, rng)
        trials = list(joint_trials(points, arguments.settings, needles, rng))
    tell(trials)
    print(f"{time.process_time() - begun:.0f} s")


if __name__ == "__main__":
    main()
