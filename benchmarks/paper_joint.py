"""Looks for a joint of which the claims of the paper hold: bearing, groove and skews, which the paper does not print.

Each joint is judged by the rules of `tripod_doe.analyses.claims` at the points of a model, in one process: cases of skew,
joint angles, torques, speeds, groove frictions, and the ablation of the mechanisms. A Sobol sequence covers the ranges; then
the best joints are mixed and moved. The four claims that hang on no joint (degrees of freedom, friction law, loci of a
needle between plates) count as held.

Run as: python benchmarks/paper_joint.py --record joints.jsonl [--model kinetostatic] [--samples 96] [--steps 240]
    python benchmarks/paper_joint.py --record joints.jsonl --judge    what the recorded joints say of the claims
    python benchmarks/paper_joint.py --record joints.jsonl --confirm needles    the best joint by another model
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import qmc

from tripod_doe.analyses.claims.verdicts import ClaimsSettings, Verdict, check_claims
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.study.cube.dataset import SWITCH_ROLE
from tripod_doe.study.definition.simulators import load_simulator

RANGES = {
    "needle_length_mm": (5.0, 12.0),
    "needle_diameter_mm": (1.6, 2.6),
    "needle_crown_um": (0.0, 15.0),
    "bearing_radial_clearance_mm": (0.005, 0.04),
    "needle_axial_clearance_mm": (0.1, 1.5),
    "rolling_lever": (0.05, 1.0),  # over the roller's radius
    "small_skew_deg": (0.2, 4.0),
    "skew_ratio": (1.3, 2.5),
    "pitch_radius_mm": (19.0, 26.0),
    "groove_radius_ratio": (1.005, 1.02),
}
NOT_OF_PARAMETERS = ("rolling_lever", "small_skew_deg", "skew_ratio")
ROLLER_RADIUS, FILLED = 16.0, 8.64  # mm; pitch diameter of 27 needles over their diameter
WITHOUT_JOINT = ("degrees_of_freedom", "friction_from_rest", "locus_equal_friction", "loci_unequal_friction")
KEPT = (
    "thrust_amplitude", "thrust_phase_deg", "thrust_amplitude_scatter", "groove_thrust_amplitude",
    "groove_thrust_phase_deg", "needle_skew_summary_deg",
)  # fmt: skip
REFERENCE = {"joint_angle_deg": 10.0, "torque_n_m": 50.0, "speed_rpm": 600.0, "groove_sliding_friction": 0.05}
ABLATION = '[study]\nname = "ablation"\n[design]\nkind = "ablation"\n'
WORST = 3.0  # relative distance from a limit, beyond which it does not matter how far
SIMULATOR = load_simulator("joint")


def skews(*values: float) -> dict[str, float]:
    return {f"initial_skew_{at}_deg": value for at, value in enumerate(values, start=1)}


def cube(rows: list[dict[str, float]], base: dict[str, float], model: str) -> xr.Dataset:
    """Points of a joint as the cube of a study."""
    full = [SIMULATOR.effective({"model": model, **base, **row}) for row in rows]
    points = {
        name: np.array(
            [math.nan if one[name] is None else one[name] for one in full], object if isinstance(value, str) else float
        )
        for name, value in full[0].items()
    }
    block = SIMULATOR.simulate(points, KEPT)
    names = dict.fromkeys(name for row in rows for name in row)
    coordinates: dict[str, Any] = {name: ("point", [one[name] for one in full], {"source": "paper"}) for name in names}
    for name in set(names) & set(MECHANISMS):
        coordinates[name][2]["role"] = SWITCH_ROLE
    outputs = {name: (("point", *values.dims), values.data) for name, values in block.outputs.items()}
    fixed = {"model": model} | {name: value for name, value in base.items() if name not in names}
    return xr.Dataset(
        outputs | {"outcome": ("point", block.outcome.astype(np.int8))},
        coordinates | dict(block.coordinates),
        {"study": ABLATION, "fixed_parameters": json.dumps(fixed)},
    )


def judged(joint: dict[str, float], model: str) -> xr.Dataset:
    """The claims by the points of a joint."""
    small = round(joint["small_skew_deg"], 3)
    large = round(small * joint["skew_ratio"], 3)
    base = {name: value for name, value in joint.items() if name not in NOT_OF_PARAMETERS}
    base["groove_rolling_lever_mm"] = joint["rolling_lever"] * ROLLER_RADIUS
    base["needle_pitch_diameter_mm"] = FILLED * joint["needle_diameter_mm"]
    first, second = skews(small, -small, small), skews(large, -large, large)
    rows = [skews(0, 0, 0), first, second, skews(large, large, large), skews(-large, large, -large)]
    rows += [
        {**case, "joint_angle_deg": angle} for case in (first, second) for angle in (4.0, 6.0, 8.0, 10.0, 12.0, 14.0)
    ]
    rows += [{**second, "torque_n_m": torque} for torque in (25.0, 50.0, 100.0)]
    rows += [{**second, "speed_rpm": speed} for speed in (300.0, 600.0, 1200.0)]
    rows += [{**second, "groove_sliding_friction": friction} for friction in (0.025, 0.05, 0.075, 0.1)]
    switched = [dict(zip(MECHANISMS, map(float, on), strict=True)) for on in itertools.product((0, 1), repeat=5)]
    cubes = {
        "points": cube([{**REFERENCE, **row} for row in rows], base, model),
        "ablation": cube(switched, base | second, model),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return check_claims(cubes, ClaimsSettings(model=model, small_skew_deg=small, large_skew_deg=large))


def entry(joint: dict[str, float], model: str) -> dict[str, Any]:
    """A joint with its claims: how many hold, which do not, and how far those are from their limits."""
    started = time.process_time()
    claims = judged(joint, model)
    values, failing, off = {}, [], 0.0
    for name in claims["claim"].values.tolist():
        if name in WITHOUT_JOINT:
            continue
        row = claims.sel(claim=name)
        value, low, high = (float(row[key]) for key in ("value", "low", "high"))
        values[name] = value if math.isfinite(value) else None
        if int(row["verdict"]) != Verdict.HOLDS:
            failing.append(name)
            limit = low if value < low else high
            off += min(abs(value - limit) / max(abs(limit), 1e-3), WORST) if math.isfinite(value) else WORST
    holds = claims.sizes["claim"] - len(failing)
    return {"model": model, "joint": joint, "holds": holds, "off": off, "fails": failing, "values": values,
            "cpu_s": time.process_time() - started}  # fmt: skip


def search(record: Path, model: str, samples: int, steps: int, seed: int) -> None:
    """Judge joints, and write a line for each."""
    low, high = (np.array(end) for end in zip(*RANGES.values(), strict=True))
    random, done = np.random.default_rng(seed), []

    def judge(place: np.ndarray) -> None:
        joint = dict(zip(RANGES, (low + (high - low) * place).tolist(), strict=True))
        one = entry(joint, model)
        done.append((one["off"] - 0.5 * one["holds"], place))
        with record.open("a") as stream:
            stream.write(json.dumps(one) + "\n")

    for place in qmc.Sobol(len(RANGES), seed=seed).random(samples):
        judge(place)
    for step in range(steps):
        done.sort(key=lambda pair: pair[0])
        one, other = (done[min(int(abs(random.normal(0, 4))), len(done) - 1)][1] for _ in range(2))
        mixed = np.where(random.random(len(RANGES)) < 0.5, one, other)
        moved = random.random(len(RANGES)) < 0.4
        judge(np.clip(mixed + moved * random.normal(0, 0.15 * (1 - step / steps / 1.25), len(RANGES)), 0, 1))


def say(record: Path) -> None:
    """Say how often each claim holds, and which ones never hold together."""
    entries = [json.loads(line) for line in record.read_text().splitlines()]
    names = sorted({name for one in entries for name in one["fails"]})
    held = {name: sum(name not in one["fails"] for one in entries) for name in names}
    best = max(entries, key=lambda one: (one["holds"], -one["off"]))
    print(f"{len(entries)} joints; the best holds {best['holds']}: {best['joint']}; not {', '.join(best['fails'])}")
    for name in sorted(names, key=held.__getitem__):
        values = [one["values"].get(name) for one in entries]
        known = np.array([value for value in values if value is not None])
        print(
            f"{name}: held by {held[name]}; values {known.min():.3g} to {known.max():.3g}, median {np.median(known):.3g}"
        )
    for a, b in itertools.combinations(names, 2):
        both = sum(a not in one["fails"] and b not in one["fails"] for one in entries)
        if not both and held[a] and held[b]:
            print(
                f"never together: {a} ({held[a]}) and {b} ({held[b]}); by chance {held[a] * held[b] / len(entries):.1f}"
            )


def main() -> None:
    """Search, say, or confirm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", type=Path, required=True, help="file with a line for each joint")
    parser.add_argument("--model", default="kinetostatic")
    parser.add_argument("--samples", type=int, default=96)
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--judge", action="store_true")
    parser.add_argument("--confirm", metavar="MODEL")
    options = parser.parse_args()
    if options.judge:
        say(options.record)
    elif options.confirm:
        entries = [json.loads(line) for line in options.record.read_text().splitlines()]
        best = max(entries, key=lambda one: (one["holds"], -one["off"]))
        print(json.dumps(entry(best["joint"], options.confirm), indent=1))
    else:
        search(options.record, options.model, options.samples, options.steps, options.seed)


if __name__ == "__main__":
    main()
