"""A robust front beside brute force: what holds for 95 % of the joints with scatter, over all joints of a grid.

A joint with 29 needles that the repository has nowhere else: third order against diameter over the rollers, with a limit on the
penetration, where two dimensions and a friction scatter. Brute force gives all joints of the grid one sample of the
scatter; ours gives all candidates of a search another one, and the last ones a third.

Run as: python benchmarks/robust_front.py [--steps 12] [--sample 64] [--share 0.25] [--seeds 3]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from moocore import hypervolume, is_nondominated
from scipy import stats

import tripod_doe as td

Array = np.ndarray[Any, Any]

QUANTILE = 0.95
PENETRATION = "largest_penetration_um"
LIMIT = 9.0
"""Largest penetration that 95 % of the joints keep, um."""
FIXED: dict[str, Any] = {
    "model": "equilibrium",
    "joint_angle_deg": 11,
    "torque_n_m": 165,
    "needle_count": 29,
    "needle_diameter_mm": 1.9,
    "needle_pitch_diameter_mm": 29 * 1.908 / math.pi,
    "groove_sliding_friction": 0.06,
}
SCATTER = {"pitch_radius_mm": 0.12, "roller_radius_mm": 0.06, "groove_sliding_friction": 0.007}
"""Standard deviations."""

FILE = """
[optimisation]
name = "robust"
quantile = {quantile}
[base]
{base}
[variables.pitch_radius_mm]
values = {pitches}
[variables.roller_radius_mm]
values = {rollers}
{scatter}
[responses.diameter]
formula = "2 * (pitch_radius_mm + roller_radius_mm)"
[objectives.third]
output = "thrust_amplitude"
order = 3
[objectives.size]
output = "diameter"
[constraints.penetration]
output = "largest_penetration_um"
high = {limit}
[search]
evaluations = {candidates}
seed = {seed}
samples = 64
confirmed = {confirmed}
confirm_samples = {sample}
"""


def brute(pitches: Sequence[float], rollers: Sequence[float], count: int) -> Array:
    """Quantiles of third order, diameter and penetration of all joints of a grid, shape (joint, quantity)."""
    joints = [(pitch, roller) for pitch in pitches for roller in rollers]
    columns: dict[str, list[Array]] = {name: [] for name in SCATTER}
    unit = stats.qmc.Sobol(len(SCATTER), rng=7000).random(count)
    for pitch, roller in joints:
        middle = FIXED | {"pitch_radius_mm": pitch, "roller_radius_mm": roller}
        for name, column in zip(SCATTER, stats.norm.ppf(unit).T, strict=True):
            columns[name].append(middle[name] + SCATTER[name] * column)
    study = {
        "study": {"name": "brute force"},
        "base": {name: value for name, value in FIXED.items() if name not in SCATTER},
        "factors": {name: {"values": np.concatenate(parts).tolist()} for name, parts in columns.items()},
        "design": {"kind": "zip"},
        "keep": {"outputs": ["thrust_amplitude", PENETRATION]},
    }
    with TemporaryDirectory() as folder:
        td.run(study, Path(folder) / "out", workers=0, progress=False)
        cube = td.open_cube(Path(folder) / "out")
        third = cube["thrust_amplitude"].sel(order=3).values.reshape(len(joints), count)
        penetration = cube[PENETRATION].values.reshape(len(joints), count)
        cube.close()
    size = 2 * (np.stack(columns["pitch_radius_mm"]) + np.stack(columns["roller_radius_mm"]))
    every = [np.quantile(each, QUANTILE, axis=1, method="median_unbiased") for each in (third, size, penetration)]
    return np.stack(every, axis=1)


def ours(pitches: Sequence[float], rollers: Sequence[float], options: argparse.Namespace, seed: int) -> Any:
    """The front of a search, and its CPU time."""
    base = "\n".join(
        f"{name} = {value!r}" if not isinstance(value, str) else f'{name} = "{value}"' for name, value in FIXED.items()
    )
    scatter = "\n".join(f'[scatter.{name}]\ndistribution = "normal"\nstd = {width}' for name, width in SCATTER.items())
    candidates = round(options.share * len(pitches) * len(rollers))
    text = FILE.format(
        quantile=QUANTILE,
        base=base,
        pitches=list(pitches),
        rollers=list(rollers),
        scatter=scatter,
        limit=LIMIT,
        candidates=candidates,
        confirmed=options.confirmed,
        sample=options.sample,
        seed=seed,
    )
    with TemporaryDirectory() as folder:
        (Path(folder) / "robust.toml").write_text(text)
        started = time.process_time()
        summary = td.optimise(Path(folder) / "robust.toml", Path(folder) / "out", workers=0, progress=False)
        return summary.front, time.process_time() - started, candidates


def volume(values: Array, low: Array, high: Array) -> float:
    """Part of a box that a front dominates."""
    return float(hypervolume((values - low) / (high - low), ref=np.ones(2))) if len(values) else 0.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the two fronts, their price, and how far they are apart."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=16, help="values of each of the two radii")
    parser.add_argument(
        "--sample", type=int, default=128, help="joints of each sample by brute force, and that confirms"
    )
    parser.add_argument("--share", type=float, default=0.25, help="part of the joints of the grid that a search tries")
    parser.add_argument("--confirmed", type=int, default=12, help="candidates that the other sample judges")
    parser.add_argument("--seeds", type=int, default=3, help="searches")
    options = parser.parse_args(arguments)
    pitches = np.linspace(20.5, 26, options.steps).round(3).tolist()
    rollers = np.linspace(14.4, 18.4, options.steps).round(3).tolist()
    td.simulate(**FIXED)  # compiled
    started = time.process_time()
    every = brute(pitches, rollers, options.sample)
    price = time.process_time() - started
    kept = np.flatnonzero(np.isfinite(every).all(axis=1) & (every[:, 2] <= LIMIT))
    best = kept[is_nondominated(np.ascontiguousarray(every[kept, :2]))]
    low, high = every[kept, :2].min(axis=0), every[kept, :2].max(axis=0)
    whole = volume(every[best, :2], low, high)
    print(
        f"brute force: {len(every)} joints, {kept.size} keep the limit, {best.size} on the front, "
        f"hypervolume {whole:.4f}, {price:.1f} CPU-s",
        flush=True,
    )
    print(
        "| seed | candidates | CPU s | of brute force | front | hypervolume, part of brute force | by the values of brute force |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |", flush=True)
    inside, compared = 0, 0
    for seed in range(1, options.seeds + 1):
        front, seconds, candidates = ours(pitches, rollers, options, seed)
        at = [
            pitches.index(float(pitch)) * len(rollers) + rollers.index(float(roller))
            for pitch, roller in zip(front["pitch_radius_mm"].values, front["roller_radius_mm"].values, strict=True)
        ]
        own = np.stack([front["third"].values, front["size"].values], axis=1)
        again = [row for row in at if row in kept]
        print(
            f"| {seed} | {candidates} | {seconds:.1f} | {seconds / price:.2f} | {len(at)}, {len(set(at) & set(best))} of them on "
            f"that of brute force | {volume(own, low, high) / whole:.3f} | {volume(every[again, :2], low, high) / whole:.3f} |",
            flush=True,
        )
        inside += int((np.abs(own[:, 0] - every[at, 0]) <= front["third_error"].values).sum())
        compared += len(at)
    print(f"{inside} of {compared} third orders lie within their stated error of the quantile by brute force")


if __name__ == "__main__":
    main(sys.argv[1:])
