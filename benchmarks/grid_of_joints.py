"""The best joint of a grid of a million, by brute force and by a search for a small part of the price.

Two radii, the number of needles and their diameter, of which the bearing follows: least third order of the thrust force at
one operating point within a diameter and a pressure of the needles, by `equilibrium`. A larger pitch radius lowers the third
order and the pressure, which is counted on a part of the grid; so the best joint has the largest pitch radius that the
diameter allows, and all joints of this edge are computed. With --whole all joints of the grid.

Run as: python benchmarks/grid_of_joints.py [--steps 100] [--whole] [--candidates 2000] [--seeds 3]
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tripod_doe as td
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.simulators import load_simulator

Array = np.ndarray[Any, Any]
Joint = tuple[float, float, float, float]
Rows = list[Joint]

BASE: dict[str, Any] = {
    "model": "equilibrium",
    "joint_angle_deg": 9.0,
    "torque_n_m": 140.0,
    "samples_per_revolution": 72,
}
NEEDLES = list(range(22, 32))
DIAMETERS = [round(1.5 + 0.1 * step, 1) for step in range(10)]
LARGEST, PRESSURE = 77.0, 1900.0
"""Diameter over the rollers, mm, and pressure of the needles, MPa, of which none may have more."""
_BLOCK = 4_000
_EVERY = (4, 12, 3, 3)  # every so many pitch radii, roller radii, needles and diameters on which steps are counted

FILE = """
[optimisation]
name = "grid"
[base]
{base}
[variables.pitch_radius_mm]
values = {pitches}
[variables.roller_radius_mm]
values = {rollers}
[variables.needle_count]
values = {needles}
[variables.needle_diameter_mm]
values = {diameters}
[variables.needle_pitch_diameter_mm]
formula = "needle_count * (needle_diameter_mm + 0.008) / 3.14159265358979"
[responses.diameter]
formula = "2 * (pitch_radius_mm + roller_radius_mm)"
[objectives.third]
output = "thrust_amplitude"
order = 3
[constraints.size]
output = "diameter"
high = {largest}
[constraints.pressure]
output = "largest_needle_pressure_mpa"
high = {pressure}
[search]
evaluations = {candidates}
seed = {seed}
"""


def answers(joints: Rows) -> Array:
    """Third orders of joints, infinite where one breaks a limit or has no answer; shape (joint,)."""
    simulator, thirds = load_simulator("joint"), np.full(len(joints), np.inf)
    for start in range(0, len(joints), _BLOCK):
        pitch, roller, count, diameter = np.array(joints[start : start + _BLOCK]).T
        block = {
            "pitch_radius_mm": pitch,
            "roller_radius_mm": roller,
            "needle_count": count,
            "needle_diameter_mm": diameter,
            "needle_pitch_diameter_mm": count * (diameter + 0.008) / math.pi,
        }
        keep = ("thrust_amplitude", "largest_needle_pressure_mpa")
        answer = simulator.simulate(simulator.columns(BASE, block, len(pitch)), keep)
        pressure = np.asarray(answer.outputs["largest_needle_pressure_mpa"].data)
        kept = (answer.outcome == Outcome.FINISHED) & (pressure <= PRESSURE)
        third = np.asarray(answer.outputs["thrust_amplitude"].data)[:, 3]
        thirds[start : start + len(pitch)] = np.where(kept, third, np.inf)
    return thirds


def grid_of(pitches: Sequence[float], rollers: Sequence[float]) -> Rows:
    """All joints of these radii, of every number of needles and diameter, that keep the diameter of the joint."""
    return [joint for joint in product(pitches, rollers, NEEDLES, DIAMETERS) if 2 * (joint[0] + joint[1]) <= LARGEST]


def edge_of(joints: Rows) -> Rows:
    """Joints with the largest pitch radius for their roller radius, needles and diameter."""
    largest: dict[tuple[float, ...], float] = {}
    for pitch, *others in joints:
        largest[tuple(others)] = max(pitch, largest.get(tuple(others), 0.0))
    return [(pitch, *others) for others, pitch in largest.items()]  # type: ignore[misc]


def count_steps(pitches: Sequence[float], rollers: Sequence[float]) -> None:
    """Print at how many steps of a part of the grid a larger pitch radius raises the third order, or loses a limit."""
    parts = [axis[::every] for axis, every in zip((pitches, rollers, NEEDLES, DIAMETERS), _EVERY, strict=True)]
    joints = [joint for joint in product(*parts) if 2 * (joint[0] + joint[1]) <= LARGEST]
    thirds = dict(zip(joints, answers(joints).tolist(), strict=True))
    following = dict(zip(parts[0], parts[0][1:], strict=False))
    ends = [(third, thirds.get((following.get(joint[0], 0.0), *joint[1:]))) for joint, third in thirds.items()]
    steps = [(one, other) for one, other in ends if other is not None and math.isfinite(one)]
    worse = sum(other >= one for one, other in steps)
    print(f"{len(steps):,} steps to a larger pitch radius: {worse} raise the third order or lose a limit", flush=True)


def brute(pitches: Sequence[float], rollers: Sequence[float], is_whole: bool) -> float:
    """The least third order of the grid; prints what was computed."""
    started = time.process_time()
    every = grid_of(pitches, rollers)
    if not is_whole:
        count_steps(pitches, rollers)
    joints = every if is_whole else edge_of(every)
    thirds = answers(joints)
    at = int(thirds.argmin())
    names = "pitch radius {:g} mm, roller radius {:g} mm, {:g} needles of {:g} mm".format(*joints[at])
    total = math.prod(map(len, (pitches, rollers, NEEDLES, DIAMETERS)))
    print(
        f"brute force: {total:,} joints, {len(every):,} within the diameter, {len(joints):,} computed, "
        f"{np.isfinite(thirds).sum():,} keep the limits; least third order {thirds[at]:.5f} N: {names}; "
        f"{time.process_time() - started:.0f} CPU-s",
        flush=True,
    )
    return float(thirds[at])


def searched(pitches: Sequence[float], rollers: Sequence[float], candidates: int, seed: int) -> tuple[float, float]:
    """The least third order of a search, and its CPU time."""
    text = FILE.format(
        base="\n".join(f"{name} = {json.dumps(value)}" for name, value in BASE.items()),
        pitches=list(pitches),
        rollers=list(rollers),
        needles=NEEDLES,
        diameters=DIAMETERS,
        largest=LARGEST,
        pressure=PRESSURE,
        candidates=candidates,
        seed=seed,
    )
    with TemporaryDirectory() as folder:
        (Path(folder) / "grid.toml").write_text(text)
        started = time.process_time()
        summary = td.optimise(Path(folder) / "grid.toml", Path(folder) / "out", workers=0, progress=False)
        return float(summary.front["third"].min()), time.process_time() - started


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the best joint by brute force, and how near each search comes for which price."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=100, help="values of each of the two radii")
    parser.add_argument("--candidates", type=int, nargs="+", default=[2_000], help="candidates of the searches")
    parser.add_argument("--seeds", type=int, default=3, help="searches with each number of candidates")
    parser.add_argument("--whole", action="store_true", help="compute all joints, not those of the edge")
    options = parser.parse_args(arguments)
    pitches = np.linspace(19.0, 26, options.steps).round(4).tolist()
    rollers = np.linspace(14.0, 18.5, options.steps).round(4).tolist()
    td.simulate(**BASE)  # compiled
    best = brute(pitches, rollers, options.whole)
    print(
        "| candidates | seed | third order, N | above the best of the grid | CPU s |\n| --- | --- | --- | --- | --- |"
    )
    for candidates in options.candidates:
        for seed in range(1, options.seeds + 1):
            third, seconds = searched(pitches, rollers, candidates, seed)
            above = 100 * (third / best - 1)
            print(f"| {candidates:,} | {seed} | {third:.5f} | {above:.3f} % | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
