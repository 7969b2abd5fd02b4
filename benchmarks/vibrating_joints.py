"""Records which joints vibrate by themselves, and what that makes of their third order: joint/known_errors/vibrating_joints.csv.

    python benchmarks/field.py rollers --count 400 --seed 230116 --record FILE
    python benchmarks/vibrating_joints.py FILE [--count 400] [--seed 230116] [--beside] [--verdict]

The joints are those of the field (field.py) that finished, followed by `rollers`, and those of model_errors.csv that
were followed with needles, none of which vibrates so much that it matters (their runs would not have finished). Each row
holds what joints are compared by, and how much the third order is changed by the vibration: over that of the same joint
by `adaptive-euler`, which damps vibrations.

`--verdict` holds the verdict that `kinetostatic` states by default against that of `rollers`, which test all joints, and both
against departures followed through a whole revolution at the joints that a first look calls calm. Those missed are followed
by `rollers`, and their answers recorded.

`--beside` records nothing: it holds the third orders with vibration that balances state against those of `rollers`, and
their price against that of `kinetostatic` at the same joint (the look that finds the vibration is not counted).
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from field import Record, all_columns, answers, field_points, internal

from tripod_doe.joint.known_errors.error_estimate import RECORDED
from tripod_doe.joint.known_errors.vibration_record import VIBRATING
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration import growing_vibration as look
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.joint.vibration.third_with_vibration import third_with_vibration
from tripod_doe.joint.vibration.vibration_verdict import undecided_rows
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.compilation.sources import source_hashes
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.model_interface import NOTABLE_ERROR, Outcome

SAMPLES, TOLERANCE = 360, 4e-3


def third_without_vibration(values: JointValues[float]) -> float:
    """Third order of the thrust in the last revolution of a motion whose vibrations are damped."""
    assembly, cycles = assemble(build_joint(values, needles=False)), int(values.cycles)
    found = run(
        assembly,
        "adaptive-euler",
        cycles * 2 * math.pi / values.speed,
        samples=cycles * SAMPLES,
        settings=Settings(tolerance=TOLERANCE),
        limits=Limits(windows=0),
    )
    last = slice(-SAMPLES, None)
    thrust = groove_thrust(assembly, found.positions[last], found.velocities[last]).sum(0)
    return float(np.abs(complex_amplitudes(thrust))[3])


def of_the_field(columns: dict[str, np.ndarray], record: Record) -> pd.DataFrame:
    """Joints of the field that are bent and finished: the followed vibration beside the motion without it."""
    outcome, _, _, orders, vibrates = answers("rollers", columns, record=record)
    changed = np.where(vibrates, np.nan, 0.0)
    known = (outcome == Outcome.FINISHED) & (columns["joint_angle_deg"] > 0)
    for row in np.flatnonzero(known & vibrates):
        values = internal(all_columns({name: column[[row]] for name, column in columns.items()})).point(0)
        changed[row] = abs(orders[row, 3]) / third_without_vibration(values) - 1
        print(f"  {row}: third order changed by {100 * changed[row]:.2g} %", flush=True)
    return compared(columns, changed)[known]


def compared(columns, changed) -> pd.DataFrame:
    """What joints are compared by, and the change of their third order."""
    return pd.DataFrame(
        {
            "joint_angle_deg": columns["joint_angle_deg"],
            "groove_friction": columns["groove_sliding_friction"],
            "needle_friction": columns["needle_sliding_friction"],
            "third_changed": changed,
        }
    )


def followed_with_needles() -> pd.DataFrame:
    """Joints of model_errors.csv whose reference is a run of `needles` that finished."""
    table = pd.read_csv(RECORDED, comment="#")
    for name in ("joint_angle_deg", "groove_sliding_friction", "needle_sliding_friction"):
        table[name] = table[name].fillna(JOINT_PARAMETERS[name].default)
    return compared(table, 0.0)[(table["needles"] == 1) & table["kinetostatic"].notna()]


def kinetostatic_milliseconds(drawn: dict[str, np.ndarray]) -> float:
    """CPU milliseconds of a joint by `kinetostatic`, which is not asked whether it vibrates."""
    model, full = MODELS["kinetostatic"], all_columns(drawn)
    method, numerics = next(iter(model.methods.items()))
    full["relative_tolerance"] = np.full(1, numerics["relative_tolerance"])
    point, began = internal(full), time.process_time()
    model.simulate(point, method, 360, {"thrust_amplitude"})
    return 1e3 * (time.process_time() - began)


def tell_beside(columns: dict[str, np.ndarray], record: Record) -> None:
    """Print the third order with vibration of each joint that vibrates beside that of `rollers`, and its price."""
    outcome, _, _, orders, vibrates = answers("rollers", columns, record=record)
    rows = np.flatnonzero(vibrates & (outcome == Outcome.FINISHED))
    errors, prices = np.full((2, rows.size), np.nan)
    for at, row in enumerate(rows):
        drawn = {name: column[[row]] for name, column in columns.items()}
        values, reference = internal(all_columns(drawn)).point(0), abs(orders[row, 3])
        if not (vibration := growing_vibration(values)):
            print(f"{row}: none grows")
            continue
        if at == 0:
            third_with_vibration(values, vibration.revolution)  # compiles
            kinetostatic_milliseconds(drawn)
        began = time.process_time()
        third = third_with_vibration(values, vibration.revolution)
        milliseconds = 1e3 * (time.process_time() - began)
        errors[at], prices[at] = third / reference - 1, milliseconds / kinetostatic_milliseconds(drawn)
        print(
            f"{row}: {reference:.4g} N, without {vibration.third:.4g} N, stated {third:.4g} N ({100 * errors[at]:+.1f} %), "
            f"{milliseconds:.0f} ms, {prices[at]:.1f} times kinetostatic",
            flush=True,
        )
    size = np.abs(errors)
    print(
        f"within 10 % at {(size <= 0.1).sum()} of {rows.size}, median {100 * np.nanmedian(size):.2g} %; price over "
        f"kinetostatic {np.nanmedian(prices):.3g} in the median, at most 20 at {(prices <= 20).sum()}"
    )


def tell_verdicts(columns: dict[str, np.ndarray], record: Record) -> None:
    """Print which joints vibrate that `kinetostatic` calls calm by default, and what that makes of their third order."""
    values, seconds = internal(all_columns(columns)), time.process_time()
    bent = np.flatnonzero(values.joint_angle > 0)
    asked = set(undecided_rows(values, bent).tolist())
    growing = [row for row in bent.tolist() if growing_vibration(values.point(row))]
    left_out = [row for row in growing if row not in asked]
    print(
        f"{bent.size} bent joints, {len(asked)} looked at; {len(growing)} vibrate as rollers test them, of which "
        f"{len(left_out)} are not looked at: {left_out}; {time.process_time() - seconds:.0f} CPU-s",
        flush=True,
    )
    missed = []
    with patch.object(look, "_may_vibrate", return_value=True):
        for row in set(bent.tolist()) - set(growing):
            if growing_vibration(values.point(row)):
                missed.append(row)
                print(
                    f"  {row} vibrates, and the first look leaves it out; {time.process_time() - seconds:.0f} CPU-s",
                    flush=True,
                )
        rows = left_out + missed
        of_missed = {name: column[rows] for name, column in columns.items()}
        orders = answers("rollers", of_missed, record=record, rows=rows)[3] if rows else np.zeros((0, 13))
    without = np.array([third_without_vibration(values.point(row)) for row in rows])
    changed = np.abs(np.abs(orders[:, 3]) / without - 1)
    print(
        f"verdicts agree at {bent.size - len(rows)} of {bent.size}; of {bent.size - len(growing) + len(left_out)} called calm "
        f"{(changed > NOTABLE_ERROR).sum()} change their third order by more than 5 %; {time.process_time() - seconds:.0f} CPU-s"
    )


def main(given: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", type=Path)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=230116)
    parser.add_argument("--out", type=Path, default=VIBRATING)
    parser.add_argument("--beside", action="store_true")
    parser.add_argument("--verdict", action="store_true")
    arguments = parser.parse_args(given)
    columns = field_points(arguments.count, np.random.default_rng(arguments.seed), "rollers")
    if arguments.verdict:
        return tell_verdicts(columns, Record(arguments.record, model="rollers, no first look", seed=arguments.seed))
    record = Record(arguments.record, model="rollers", seed=arguments.seed, calm=False)
    if arguments.beside:
        return tell_beside(columns, record)
    field = of_the_field(columns, record)
    table = pd.concat([field, followed_with_needles()], ignore_index=True)
    head = (
        f"# made by benchmarks/vibrating_joints.py, sources {source_hashes().results}, from {len(field)} joints of the "
        f"field (seed {arguments.seed}), and from {RECORDED.name}\n"
    )
    arguments.out.write_text(head + table.to_csv(index=False, float_format="%.4g"), encoding="utf-8")


if __name__ == "__main__":
    main()
