"""The best joint of a grid of a million, by brute force and by a search for a small part of the price.

Two radii, the number of needles and their diameter, of which the bearing follows: least third order of the thrust force at
one operating point within a diameter and a pressure of the needles, by `equilibrium`. Brute force computes the joints of
every fifth radius, and then all joints up to five radii, one needle and one diameter from the fifty best; with --every 1 the
whole grid.

Run as: python benchmarks/grid_of_joints.py [--steps 100] [--every 5] [--candidates 2000] [--seeds 3]
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
from tripod_doe.study.definition.scenes import load_simulator

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
_BEST = 50  # joints around which all others are computed

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


def around(joint: Joint, axes: Sequence[Sequence[float]], reach: Sequence[int]) -> Rows:
    """Joints of a grid up to some steps from one of them."""
    near = []
    for value, axis, steps in zip(joint, axes, reach, strict=True):
        at = axis.index(value)
        near.append(axis[max(at - steps, 0) : at + steps + 1])
    return [each for each in product(*near) if 2 * (each[0] + each[1]) <= LARGEST]


def brute(pitches: Sequence[float], rollers: Sequence[float], every: int) -> float:
    """The least third order of the grid; prints what was computed.

    Args:
        every: Of the radii, every so many are computed, then all joints around the best of these; 1 for the whole grid.
    """
    started, axes = time.process_time(), (pitches, rollers, NEEDLES, DIAMETERS)
    joints = grid_of(pitches[::every], rollers[::every])
    thirds = answers(joints)
    if every > 1:
        best = [joints[at] for at in np.argsort(thirds)[:_BEST]]
        near = {each for joint in best for each in around(joint, axes, (every, every, 1, 1))} - set(joints)
        joints, thirds = [*joints, *near], np.concatenate([thirds, answers(list(near))])
    at = int(thirds.argmin())
    names = "pitch radius {:g} mm, roller radius {:g} mm, {:g} needles of {:g} mm".format(*joints[at])
    print(
        f"brute force: {math.prod(map(len, axes)):,} joints, {len(joints):,} computed, {np.isfinite(thirds).sum():,} keep the "
        f"limits; least third order {thirds[at]:.5f} N: {names}; {time.process_time() - started:.0f} CPU-s",
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
    parser.add_argument(
        "--every", type=int, default=5, help="every so many radii are computed first; 1 for the whole grid"
    )
    options = parser.parse_args(arguments)
    pitches = np.linspace(19.0, 26, options.steps).round(4).tolist()
    rollers = np.linspace(14.0, 18.5, options.steps).round(4).tolist()
    td.simulate(**BASE)  # compiled
    best = brute(pitches, rollers, options.every)
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
