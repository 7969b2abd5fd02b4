"""How often the 95 % intervals of fits hold, and whether the next record gains what was promised.

Rigs with hidden joints: random frictions and skews, eight random operating points, noise and scatter as in
measurements/make_rig.py. Each rig is fitted; where a candidate is asked for, its record is made, too, and all nine
records are fitted again.

Run as: python benchmarks/fit.py --truth kinetostatic --model equilibrium --rigs 40 [--orders 2,3] [--next]
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

import tripod_doe as td

sys.path.append(str(Path(__file__).parents[1] / "measurements"))
import make_rig

RANGES = {
    "groove_sliding_friction": (0.02, 0.15),
    "needle_sliding_friction": (0.01, 0.1),
    "initial_skew_1_deg": (-1.0, 1.0),
    "initial_skew_2_deg": (-1.0, 1.0),
}
"""Bounds of the unknowns; hidden values lie in the middle half of each."""

KNOWN = {
    "needle_length_mm": (8.0, 11.0),
    "bearing_radial_clearance_mm": (0.008, 0.03),
    "needle_axial_clearance_mm": (0.1, 0.4),
    "groove_radius_ratio": (1.006, 1.02),
}
"""What is known of a joint and differs between joints, where the fitted model is not the hidden one."""

RECORDS = 8
ANGLES, TORQUES, SPEEDS = [4.0, 8.0, 12.0], [50.0, 150.0, 300.0], [600.0]


def hidden_joint(random: np.random.Generator, names: list[str]) -> dict[str, float]:
    """Hidden values of the unknowns."""
    part = {name: 0.25 + 0.5 * random.random() for name in names}
    return {name: low + part[name] * (high - low) for name, (low, high) in RANGES.items() if name in names}


def known_joint(random: np.random.Generator, options: argparse.Namespace) -> dict[str, float]:
    """Geometry of a joint, as its drawing states it."""
    if options.truth == options.model:
        return {}
    return {name: round(low + (high - low) * random.random(), 3) for name, (low, high) in KNOWN.items()}


def operating_points(random: np.random.Generator) -> list[tuple[float, float, float]]:
    """Joint angle, torque and speed of each record."""
    places = random.random((RECORDS, 3))
    low, high = np.array([4.0, 50.0, 300.0]), np.array([14.0, 300.0, 1200.0])
    return [(float(a), float(t), float(s)) for a, t, s in (low + (high - low) * places).round(1)]


def write_rig(
    folder: Path, model: str, truth: dict[str, float], points: list[tuple[float, float, float]], seed: int, zero: bool
) -> bool:
    """Write the records of a rig; returns whether the joint has an answer at all points."""
    random, rows = np.random.default_rng(seed), []
    for number, values in enumerate(points, start=1):
        point = {"model": model, **truth, **dict(zip(make_rig.OPERATING, values, strict=True))}
        try:
            table = make_rig.record(point, random.uniform(0, 360) if zero else 0.0, random)
        except KeyError:  # no thrust: the point did not finish
            return False
        lines = [f"{moment:.6f},{angle:.1f},{force:.4f}" for moment, angle, force in table]
        name = f"record_{number}.csv"
        (folder / name).write_text("\n".join(["time_s,rotation_deg,thrust_n", *lines, ""]))
        rows.append([name, *values])
    with (folder / "records.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([["file", *make_rig.OPERATING], *rows])
    return True


def fit_text(names: list[str], options: argparse.Namespace, zero: bool, known: dict[str, float]) -> str:
    """The fit file."""
    error = "0" if options.truth == options.model else '"recorded"'
    lines = ["[fit]", 'name = "rig"', f"model_error = {error}", "[base]", f'model = "{options.model}"']
    lines += [f"{name} = {value}" for name, value in known.items()]
    for name in names:
        low, high = RANGES[name]
        lines += [f"[unknowns.{name}]", f"low = {low}", f"high = {high}"]
    lines += ["[records]", 'table = "records.csv"', f"orders = [{options.orders}]"]
    lines += [] if zero else ["reference_angle_deg = 0"]
    lines += ["[next]", f'narrow = "{names[1]}"', "within = 0.05"]
    for name, values in zip(make_rig.OPERATING, (ANGLES, TORQUES, SPEEDS), strict=True):
        lines += [f"[next.at.{name}]", f"values = {values}"]
    return "\n".join([*lines, ""])


def half_width(result: xr.Dataset, name: str) -> float:
    """Half of an interval."""
    own = result.sel(unknown=name)
    return float(own["high"] - own["low"]) / 2


def one_rig(number: int, options: argparse.Namespace) -> dict[str, Any] | None:
    """Fit one rig; None where its joint has no answer at some point."""
    random = np.random.default_rng([options.seed, number])
    names = list(RANGES)[: 4 if "2" in options.orders.split(",") else 2]
    truth, points, zero = hidden_joint(random, names), operating_points(random), bool(number % 2)
    known = known_joint(random, options)
    joint = truth | known
    with TemporaryDirectory() as place:
        folder = Path(place)
        if not write_rig(folder, options.truth, joint, points, number, zero):
            return None
        (folder / "fit.toml").write_text(fit_text(names, options, zero, known))
        started = time.process_time()
        result = td.fit(folder / "fit.toml", folder / "out", workers=0, progress=False).result
        row: dict[str, Any] = {"rig": number, "cpu_s": time.process_time() - started, "points": result.attrs["points"]}
        row |= {"scatter": float(result.attrs["scatter"]), "left_out": int(result["left_out"].sum())}
        for name in names:
            own = result.sel(unknown=name)
            row[f"{name}_holds"] = int(float(own["low"]) <= truth[name] <= float(own["high"]))
            row[f"{name}_half"] = half_width(result, name)
            row[f"{name}_off"] = float(own["value"]) - truth[name]
            row[f"{name}_verdict"] = str(own["verdict"].item())
        if options.next and row[f"{names[1]}_verdict"] == "found":
            best = int(np.nanargmin(result["next"].values))
            point = tuple(float(result[f"candidate_{name}"][best]) for name in make_rig.OPERATING)
            row["promised"] = float(result["next"][best])
            if write_rig(folder, options.truth, joint, [*points, point], number, zero):
                again = td.fit(folder / "fit.toml", folder / "out", workers=0, progress=False).result
                row["gained"] = half_width(again, names[1]) / half_width(result, names[1])
    return row


def main() -> None:
    """Fit all rigs, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truth", default="kinetostatic", help="model of the hidden joints")
    parser.add_argument("--model", default="kinetostatic", help="model that is fitted")
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--orders", default="2,3")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--next", action="store_true", help="measure the best candidate of each rig, too")
    parser.add_argument("--record", type=Path, help="CSV file of all rigs")
    options = parser.parse_args()
    rows = []
    for number in range(options.first, options.first + options.rigs):
        if (row := one_rig(number, options)) is None:
            continue
        rows.append(row)
        print(", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
        if options.record:
            with options.record.open("w", newline="") as stream:
                writer = csv.DictWriter(stream, list(dict.fromkeys(key for each in rows for key in each)))
                writer.writeheader()
                writer.writerows(rows)
    for name in [key.removesuffix("_holds") for key in rows[0] if key.endswith("_holds")]:
        holds = [row[f"{name}_holds"] for row in rows]
        words = [row[f"{name}_verdict"] for row in rows]
        counts = ", ".join(f"{words.count(word)} {word}" for word in sorted(set(words)))
        print(f"{name}: {sum(holds)} of {len(holds)} intervals hold; {counts}")
    gained = np.array([row["gained"] / row["promised"] for row in rows if "gained" in row])
    if gained.size:
        print(f"gained over promised: median {np.median(gained):.3f}, {gained.min():.3f} to {gained.max():.3f}")
    print(f"CPU seconds a fit: median {np.median([row['cpu_s'] for row in rows]):.1f}")


if __name__ == "__main__":
    main()
