"""What a front costs, and how good it is: searched on a cheap model and confirmed, beside plain loops of pymoo and Optuna.

A joint with 29 needles at three operating points: third order against diameter, with a limit on the pressure of the
needles. Everybody's front is judged by the fine model. Means over some seeds, with the smallest and the largest.

Run as: python benchmarks/optimisation.py [--fine needles] [--candidates 400] [--direct 60] [--seeds 5] [--only NAME]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from moocore import hypervolume, is_nondominated

import tripod_doe as td
from tripod_doe.errors import InputError
from tripod_doe.study.simulate import simulate_point

DIAMETERS = [1.6, 1.8, 2.0, 2.2, 2.5]
RANGES = {"pitch_radius_mm": (20.0, 26.0), "roller_radius_mm": (14.0, 18.5)}
FIXED: dict[str, Any] = {"needle_count": 29, "torque_n_m": 130.0}
ANGLES = [4.0, 8.0, 12.0]
"""Joint angles of the operating points, degrees."""
LIMIT = 1900.0
"""Largest pressure of the needles, MPa."""
WORST = (60.0, 90.0)
"""Third order (N) and diameter (mm) from which hypervolumes are measured, in parts of both."""

FILE = """
[optimisation]
name = "29 needles"
[base]
model = "{cheap}"
needle_count = 29
torque_n_m = 130
[variables.pitch_radius_mm]
low = 20
high = 26
[variables.roller_radius_mm]
low = 14
high = 18.5
[variables.needle_diameter_mm]
values = [1.6, 1.8, 2.0, 2.2, 2.5]
[variables.needle_pitch_diameter_mm]
formula = "needle_count * (needle_diameter_mm + 0.008) / 3.14159265"
[at.joint_angle_deg]
values = {angles}
[responses.diameter]
formula = "2 * (pitch_radius_mm + roller_radius_mm) + 0 * largest_needle_pressure_mpa"
[objectives.third]
output = "thrust_amplitude"
order = 3
[objectives.size]
output = "diameter"
[constraints.pressure]
output = "largest_needle_pressure_mpa"
high = 1900
[search]
evaluations = {candidates}
seed = {seed}
confirm = "{fine}"
confirmed = {confirmed}
"""


def judge(place: Sequence[float], model: str) -> tuple[float, float, float]:
    """Third order, diameter and pressure of a candidate (two radii, number of a diameter), as a plain loop has them."""
    pitch, roller, diameter = float(place[0]), float(place[1]), DIAMETERS[int(place[2])]
    own = {"pitch_radius_mm": pitch, "roller_radius_mm": roller, "needle_diameter_mm": diameter}
    own["needle_pitch_diameter_mm"] = 29 * (diameter + 0.008) / math.pi
    thirds, pressures = [], []
    for angle in ANGLES:
        try:
            point = simulate_point(
                "joint", ("largest_needle_pressure_mpa",), model=model, joint_angle_deg=angle, **FIXED, **own
            )
        except InputError:
            return math.nan, math.nan, math.nan
        if "thrust_amplitude" not in point.outputs:
            return math.nan, math.nan, math.nan
        thirds.append(float(point.outputs["thrust_amplitude"].data[3]))
        pressures.append(float(point.outputs["largest_needle_pressure_mpa"].data))
    return max(thirds), 2 * (pitch + roller), max(pressures)


class Front(NamedTuple):
    """The front of one way, as the fine model judges it."""

    seconds: float
    values: np.ndarray[Any, Any]
    note: str


class Tried:
    """Candidates of a plain loop: places, values, and the CPU time since the loop began."""

    def __init__(self) -> None:
        self.places: list[Sequence[float]] = []
        self.values: list[tuple[float, float, float]] = []
        self.seconds: list[float] = []
        self._started = time.process_time()

    def judge(self, place: Sequence[float], model: str) -> tuple[float, float, float]:
        """Judge a candidate, and keep it."""
        self.places.append(place)
        self.values.append(judge(place, model))
        self.seconds.append(time.process_time() - self._started)
        return self.values[-1]


def volume(front: np.ndarray[Any, Any]) -> float:
    """Part of the box below `WORST` that a front dominates."""
    inside = front[np.isfinite(front).all(axis=1) & (front < WORST).all(axis=1)]
    return float(hypervolume(inside / np.array(WORST), ref=np.ones(2))) if len(inside) else 0.0


def front_of(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Numbers of the candidates that keep the limit and that no other one dominates."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & (values[:, 2] <= LIMIT))
    return rows[is_nondominated(np.ascontiguousarray(values[rows, :2]))] if rows.size else rows


def ours(options: argparse.Namespace, seed: int) -> Front:
    """Our command: the search on the cheap model, confirmed by the fine one."""
    text = FILE.format(
        angles=ANGLES,
        cheap=options.cheap,
        fine=options.fine,
        candidates=options.candidates,
        confirmed=options.confirmed,
        seed=seed,
    )
    with TemporaryDirectory() as folder:
        (Path(folder) / "joint.toml").write_text(text)
        started = time.process_time()
        summary = td.optimise(Path(folder) / "joint.toml", Path(folder) / "out", workers=0, progress=False)
        seconds = time.process_time() - started
    judged = int(summary.front.attrs["confirmed"])
    values = np.stack([summary.front["third"].values, summary.front["size"].values], axis=1)
    return Front(seconds, values, f"{len(values)} of {judged} judged" if judged else f"{len(values)} on the front")


def with_pymoo(options: argparse.Namespace, model: str, candidates: int, seed: int) -> Tried:
    """A plain loop around NSGA-II of pymoo."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    tried = Tried()

    class Joint(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            low, high = zip(*RANGES.values(), (0.0, len(DIAMETERS) - 1e-9), strict=True)
            super().__init__(n_var=3, n_obj=2, n_ieq_constr=1, xl=np.array(low), xu=np.array(high))

        def _evaluate(self, x: Any, out: dict[str, Any], *_: Any, **__: Any) -> None:
            third, size, pressure = tried.judge([float(value) for value in x], model)
            whole = math.isfinite(third)
            out["F"] = [third, size] if whole else [1e6, 1e6]  # which pymoo leaves to its user
            out["G"] = [pressure / LIMIT - 1 if whole else 10.0]

    minimize(Joint(), NSGA2(pop_size=min(20, candidates)), ("n_eval", candidates), seed=seed)
    return tried


def with_optuna(options: argparse.Namespace, model: str, candidates: int, seed: int) -> Tried:
    """A plain loop around NSGA-II of Optuna."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    tried = Tried()

    def value(trial: Any) -> tuple[float, float]:
        place = [trial.suggest_float(name, *ends) for name, ends in RANGES.items()]
        place.append(trial.suggest_int("diameter", 0, len(DIAMETERS) - 1))
        found = tried.judge(place, model)
        trial.set_user_attr("far", [found[2] / LIMIT - 1 if math.isfinite(found[2]) else 10.0])
        return (found[0], found[1]) if math.isfinite(found[0]) else (1e6, 1e6)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its constraints are experimental
        sampler = optuna.samplers.NSGAIISampler(
            population_size=min(20, candidates), seed=seed, constraints_func=lambda trial: trial.user_attrs["far"]
        )
        optuna.create_study(directions=["minimize", "minimize"], sampler=sampler).optimize(value, n_trials=candidates)
    return tried


def plain(search: Any, options: argparse.Namespace, model: str, candidates: int, seed: int) -> Front:
    """A plain loop; where it ran on the cheap model, as many of its front as ours confirms are judged by the fine one."""
    tried = search(options, model, candidates, seed)
    values = np.array(tried.values)
    rows = front_of(values)
    if model == options.fine:
        return Front(tried.seconds[-1], values[rows, :2], f"{rows.size} of {len(values)}")
    chosen = (
        rows[np.unique(np.linspace(0, rows.size - 1, options.confirmed).round().astype(int))] if rows.size else rows
    )
    started = time.process_time()
    fine = np.array([judge(tried.places[row], options.fine) for row in chosen]).reshape(-1, 3)
    seconds = tried.seconds[-1] + time.process_time() - started
    kept = np.isfinite(fine[:, 2]) & (fine[:, 2] <= LIMIT)
    return Front(seconds, fine[kept, :2], f"{kept.sum()} of {len(fine)} judged")


def compare(options: argparse.Namespace) -> None:
    """Price and front of each way, in a table."""
    judge([23.0, 17.0, 2], options.cheap), judge([23.0, 17.0, 2], options.fine)  # compiled, and warm
    started = time.process_time()
    judge([22.0, 16.0, 1], options.fine)
    print(f"a candidate by {options.fine}: {time.process_time() - started:.3g} CPU-s", flush=True)
    cheap, fine, many, few = options.cheap, options.fine, options.candidates, options.direct
    ways: dict[str, tuple[str, Callable[[int], Front]]] = {
        "ours": (f"`tripod-doe optimise`, {many} by {cheap}, judged by {fine}", lambda seed: ours(options, seed)),
        "pymoo": (
            f"pymoo, {many} by {cheap}, {options.confirmed} judged by {fine}",
            lambda seed: plain(with_pymoo, options, cheap, many, seed),
        ),
        "optuna": (
            f"Optuna, {many} by {cheap}, {options.confirmed} judged by {fine}",
            lambda seed: plain(with_optuna, options, cheap, many, seed),
        ),
        "direct": (f"pymoo, {few} by {fine} itself", lambda seed: plain(with_pymoo, options, fine, few, seed)),
    }
    print("| way | CPU s | hypervolume | candidates that keep the limit |\n| --- | --- | --- | --- |", flush=True)
    for name, (label, way) in ways.items():
        if options.only and name not in options.only:
            continue
        try:
            fronts = [way(seed) for seed in range(1, options.seeds + 1)]
        except ImportError:
            print(f"| {name} | not installed | | |", flush=True)
            continue
        seconds, volumes = [front.seconds for front in fronts], [volume(front.values) for front in fronts]
        notes = "; ".join(front.note for front in fronts)
        print(f"| {label} | {_spread(seconds, 1)} | {_spread(volumes, 4)} | {notes} |", flush=True)


def _spread(values: Sequence[float], digits: int) -> str:
    """Mean, smallest and largest value."""
    mean, low, high = float(np.mean(values)), min(values), max(values)
    return f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cheap", default="kinetostatic", help="model of the search")
    parser.add_argument("--fine", default="needles", help="model that has the last word")
    parser.add_argument("--candidates", type=int, default=400, help="candidates of a search on the cheap model")
    parser.add_argument("--confirmed", type=int, default=6, help="candidates that the fine model judges")
    parser.add_argument("--direct", type=int, default=60, help="candidates of the search on the fine model itself")
    parser.add_argument("--angles", type=float, nargs="+", default=ANGLES, help="joint angles of the operating points")
    parser.add_argument("--only", nargs="*", default=[], choices=["ours", "pymoo", "optuna", "direct"])
    parser.add_argument("--seeds", type=int, default=1, help="searches of each way")
    options = parser.parse_args(arguments)
    ANGLES[:] = options.angles
    compare(options)


if __name__ == "__main__":
    main(sys.argv[1:])
