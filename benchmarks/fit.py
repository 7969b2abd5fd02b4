"""How often the 95 % intervals of fits hold, and whether the next record gains what was promised.

Rigs with hidden joints: random frictions and skews, some random operating points, noise and scatter as in
measurements/make_rig.py, every second marker at an angle that is not known, every third rig with a tachometer of six
pulses that bounces and misses. Each rig is fitted; where a candidate is asked for, its record is made, too, and all
records are fitted again. Nothing of the fit takes part in what is hidden: that is the answer of another model, or
of the same with errors that are drawn here, as benchmarks/errors_between_records.py found them.

Run as: python benchmarks/fit.py --truth kinetostatic --model equilibrium --rigs 40 [--orders 2,3] [--next]
    python benchmarks/fit.py --truth rollers --records 6 --rigs 100
    python benchmarks/fit.py --truth needles --points needles.jsonl --rigs 20
    python benchmarks/fit.py --truth drawn --records 6 --draws 10 --rigs 100

With --draws, so many rigs have the same geometry and operating points, other hidden values, errors and noise; hidden and
fitted model are `kinetostatic` interpolated between 257 places of the unknowns, for a third of the price.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: more only wait for each other

import numpy as np
import xarray as xr
from scipy.interpolate import RBFInterpolator
from scipy.stats import beta, qmc

from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.model_error import Needles
from tripod_doe.analyses.fit.next_record import next_record
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.result import fit_dataset
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.simulators import load_simulator

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

LOOSE = (1.2, 1.6)
"""Axial clearance in mm of needles that reach no stop, so keep their skew, as all needles do in `rollers`."""

SIMULATOR = load_simulator("joint")
KEPT = (
    "thrust_amplitude", "thrust_phase_deg", "groove_thrust_amplitude", "groove_thrust_phase_deg",
    "needle_skew_summary_deg",
)  # fmt: skip
ANGLES, TORQUES, SPEEDS = [4.0, 8.0, 12.0], [50.0, 150.0, 300.0], [600.0]
AHEAD = np.exp(2j * np.radians(120) * np.arange(3))
# Drawn errors: of the second order as parts of what each groove gives and of what turning adds, in a record alone and
# alike at similar joint angles; of the third as parts of itself. A joint has its own size of each, over the usual one.
OF_GROOVE, OF_TURNING, OF_THIRD = (0.1, 0.09), (0.05, 0.31), (0.004, 0.005)
NEAR, SPREAD = 0.2, 0.7  # of the logarithm of the angle; of the logarithm of a joint's own size
PULSES, BOUNCES, MISSES = 6, 0.03, 0.02  # of a bad tachometer


def hidden_joint(random: np.random.Generator, names: list[str]) -> dict[str, float]:
    """Hidden values of the unknowns."""
    part = {name: 0.25 + 0.5 * random.random() for name in names}
    return {name: low + part[name] * (high - low) for name, (low, high) in RANGES.items() if name in names}


def known_joint(random: np.random.Generator, options: argparse.Namespace) -> dict[str, float]:
    """Geometry of a joint, as its drawing states it."""
    if options.truth == options.model:
        return {}
    ranges = KNOWN | ({"needle_axial_clearance_mm": LOOSE} if options.truth == "rollers" else {})
    return {name: round(low + (high - low) * random.random(), 3) for name, (low, high) in ranges.items()}


def operating_points(random: np.random.Generator, records: int = 8) -> list[tuple[float, float, float]]:
    """Joint angle, torque and speed of each record."""
    places = random.random((records, 3))
    low, high = np.array([4.0, 50.0, 300.0]), np.array([14.0, 300.0, 1200.0])
    return [(float(a), float(t), float(s)) for a, t, s in (low + (high - low) * places).round(1)]


class HiddenOrders:
    """Complex orders of a hidden model; those in a file are not computed again.

    Args:
        file: A line for each point; None to compute all.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        lines = file.read_text().splitlines() if file is not None and file.exists() else []
        self._known: dict[str, list[list[float]]] = dict(json.loads(line) for line in lines)

    def __call__(self, point: dict[str, Any]) -> np.ndarray | None:
        """Orders of a point, shape (order,); None where it did not finish."""
        key = json.dumps(point, sort_keys=True)
        if key not in self._known:
            try:
                orders = make_rig.orders(point)
            except KeyError:  # no thrust: the point did not finish
                orders = np.zeros(0)
            self._known[key] = [np.abs(orders).tolist(), np.degrees(np.angle(orders)).tolist()] if orders.size else []
            if self._file is not None:
                with self._file.open("a") as stream:
                    stream.write(json.dumps([key, self._known[key]]) + "\n")
        if not self._known[key]:
            return None
        amplitude, phase = np.array(self._known[key])
        return np.asarray(amplitude * np.exp(1j * np.radians(phase)))


def computed(columns: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a model says of points with all their parameters; NaN where one fails.

    Returns:
        Complex orders in N (point, order), complex second order at each groove (point, groove), and the mean skew of the
        needles in the last revolution in deg (point, groove), NaN of models without needles.
    """
    block = SIMULATOR.simulate(columns, KEPT)
    values = {name: output.data for name, output in block.outputs.items()}
    bad = block.outcome != Outcome.FINISHED

    def complex_of(name: str) -> np.ndarray:
        own = np.asarray(values[f"{name}_amplitude"] * np.exp(1j * np.radians(values[f"{name}_phase_deg"])))
        own[bad] = np.nan
        return own

    skew = values.get("needle_skew_summary_deg", np.full((bad.size, 3, 1, 1), np.nan))[:, :, -1, 0]
    return complex_of("thrust"), complex_of("groove_thrust")[..., 2], skew


class Between:
    """`kinetostatic` interpolated between places of the unknowns, at each operating point of each geometry."""

    PLACES = 257

    def __init__(self) -> None:
        self._known: dict[str, RBFInterpolator] = {}

    def __call__(self, columns: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `computed`; all columns are numbers but that of the model."""
        others = [name for name in columns if name not in RANGES]
        place = np.stack([_place(name, columns[name]) for name in RANGES], axis=1)
        values = list(zip(*(columns[name].tolist() for name in others), strict=True))
        keys = [repr(own) for own in values]  # NaN is not itself
        parts = np.empty((len(keys), 35))
        for key in dict.fromkeys(keys):
            rows = [at for at, own in enumerate(keys) if own == key]
            if key not in self._known:
                self._known[key] = self._between(dict(zip(others, values[rows[0]], strict=True)))
            parts[rows] = self._known[key](place[rows])
        real, imaginary, second_real, second_imaginary, skew = np.split(parts, [13, 26, 29, 32], axis=1)
        return real + 1j * imaginary, second_real + 1j * second_imaginary, skew

    def _between(self, operating: dict[str, Any]) -> RBFInterpolator:
        places = np.vstack([np.full(4, 0.5), qmc.Sobol(4, seed=0).random(self.PLACES - 1)])
        columns = {name: np.array([value] * len(places)) for name, value in operating.items()}
        columns["model"] = columns["model"].astype(object)
        for at, (name, (low, high)) in enumerate(RANGES.items()):
            columns[name] = low + (high - low) * places[:, at]
        orders, second, skew = computed(SIMULATOR.columns({}, columns, len(places)))
        whole = np.isfinite(orders).all(axis=1)
        parts = np.hstack([orders.real, orders.imag, second.real, second.imag, skew])
        return RBFInterpolator(places[whole], parts[whole], kernel="cubic", degree=2)


def _place(name: str, values: np.ndarray) -> np.ndarray:
    low, high = RANGES[name]
    return (np.asarray(values, float) - low) / (high - low)


def drawn_orders(points: list[dict[str, float]], seed: int, answers: Any) -> list[np.ndarray] | None:
    """Orders by `kinetostatic` at the points of a joint with an error drawn for them.

    One more point leaves the errors at the others as they are.
    """
    columns = {name: np.array([point[name] for point in points], float) for name in points[0]}
    columns |= {"model": np.array(["kinetostatic"] * len(points), object)}
    orders, groove, skew = answers(SIMULATOR.columns({}, columns, len(points)))
    if not np.isfinite(orders).all():
        return None
    angles = np.log([point["joint_angle_deg"] for point in points])
    alike = np.linalg.cholesky(
        np.exp(-((np.subtract.outer(angles, angles) / NEAR) ** 2) / 2) + 1e-9 * np.eye(len(points))
    )

    chance = np.stack([np.random.default_rng([seed, 77, at]).standard_normal((7, 4)) for at in range(len(points))], -1)

    def errors(which: int, own: float, shared: float) -> np.ndarray:
        """Relative errors at all points, real and imaginary part of these deviations."""
        each, together = chance[which, :2], chance[which, 2:]
        return own * (each[0] + 1j * each[1]) + shared * (alike @ (together[0] + 1j * together[1]))

    initial = np.array([[point[f"initial_skew_{at}_deg"] for at in (1, 2)] + [0.0] for point in points])
    each = (groove * np.conj(AHEAD) * skew).sum(axis=1) / (skew**2).sum(axis=1)
    turned = each[:, None] * AHEAD * (skew - initial)
    second = sum(
        errors(at, *OF_GROOVE) * groove[:, at] + errors(3 + at, *OF_TURNING) * turned[:, at] for at in range(3)
    )
    size = np.exp(SPREAD * np.random.default_rng([seed, 77]).standard_normal(2))
    orders[:, 2] += size[0] * second
    orders[:, 3] *= 1 + size[1] * errors(6, *OF_THIRD)
    return list(orders)


def hidden_records(points: list[dict[str, Any]], options: argparse.Namespace, seed: int) -> list[np.ndarray] | None:
    """Orders of the hidden joint at some points; None where it has no answer at one."""
    if options.truth == "drawn":
        return drawn_orders(points, seed, options.answers)
    found = [options.hidden({"model": options.truth, **point}) for point in points]
    return None if any(one is None for one in found) else found  # type: ignore[return-value]


def tachometer(turned: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Voltage of a tachometer whose contacts bounce and miss; the first pulse begins at zero."""
    place = turned * PULSES / 360
    pulse = np.floor(place + 1e-9).astype(int)
    high = place - pulse < 0.4
    high &= (random.random(pulse.max() + 1) > MISSES)[pulse]
    bounced = (random.random(pulse.max() + 1) < BOUNCES)[pulse]
    first = np.concatenate([[True], pulse[1:] != pulse[:-1]])
    high[1:] &= ~(bounced[1:] & first[:-1])  # low for a sample after the edge
    return np.where(high, 5.0, 0.1) + 0.05 * random.standard_normal(turned.size)


def write_rig(
    folder: Path, joint: dict[str, float], points: list[tuple[float, float, float]], number: int, options: Any
) -> bool:
    """Write the records of a rig; returns whether the joint has an answer at all points."""
    random, rows = np.random.default_rng(number), []
    full = [{**joint, **dict(zip(make_rig.OPERATING, values, strict=True))} for values in points]
    orders = hidden_records(full, options, number)
    if orders is None:
        return False
    for at, (values, own) in enumerate(zip(points, orders, strict=True), start=1):
        name, zero = f"record_{at}.csv", random.uniform(0, 360) if has_no_zero(number) else 0.0
        if has_tachometer(number):
            table = make_rig.record(own, values[2], zero, random, 720)
            table[:, 1] = tachometer(table[:, 1], random)
            head = "time_s,tacho_v,thrust_n"
        else:
            table, head = make_rig.record(own, values[2], zero, random), "time_s,rotation_deg,thrust_n"
        lines = [f"{moment:.6f},{middle:.2f},{force:.4f}" for moment, middle, force in table]
        (folder / name).write_text("\n".join([head, *lines, ""]))
        rows.append([name, *values])
    with (folder / "records.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([["file", *make_rig.OPERATING], *rows])
    return True


def has_no_zero(number: int) -> bool:
    """Whether the angle of the marker of a rig is not known."""
    return number % 2 == 1 or has_tachometer(number)


def has_tachometer(number: int) -> bool:
    """Whether a rig has a bad tachometer in place of an encoder."""
    return number % 3 == 2


def fit_text(names: list[str], options: argparse.Namespace, number: int, known: dict[str, float]) -> str:
    """The fit file."""
    error = "0" if options.truth == options.model else '"recorded"'
    lines = ["[fit]", 'name = "rig"', f"model_error = {error}", "[base]", f'model = "{options.model}"']
    lines += [f"{name} = {value}" for name, value in known.items()]
    for name in names:
        low, high = RANGES[name]
        lines += [f"[unknowns.{name}]", f"low = {low}", f"high = {high}"]
    lines += ["[records]", 'table = "records.csv"', f"orders = [{options.orders}]"]
    lines += [f"pulses_per_revolution = {PULSES}"] if has_tachometer(number) else []
    lines += [] if has_no_zero(number) else ["reference_angle_deg = 0"]
    if not options.next:
        return "\n".join([*lines, ""])
    lines += ["[next]", f'narrow = "{names[1]}"', "within = 0.05"]
    for name, values in zip(make_rig.OPERATING, (ANGLES, TORQUES, SPEEDS), strict=True):
        lines += [f"[next.at.{name}]", f"values = {values}"]
    return "\n".join([*lines, ""])


class Model:
    """Points of a fit without journal and page: each is computed once.

    Args:
        rig: The fit, which knows all parameters of its points.
        answers: `computed`, or what stands for it.
    """

    def __init__(self, rig: FitProblem, answers: Any) -> None:
        self._rig, self._answers = rig, answers
        self._known: dict[tuple[Any, ...], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def __call__(self, columns: Any) -> tuple[np.ndarray, Needles]:
        """Complex orders of points, and their needles, see `tripod_doe.analyses.fit.problem.Answers`."""
        keys = list(zip(*(column.tolist() for column in columns.values()), strict=True))
        place = {key: at for at, key in enumerate(keys)}
        new = [at for key, at in place.items() if key not in self._known]
        if new:
            own = self._answers(self._rig.all_columns({name: column[new] for name, column in columns.items()}))
            self._known |= {keys[at]: row for at, row in zip(new, zip(*own, strict=True), strict=True)}
        orders, second, skew = (np.array(part) for part in zip(*(self._known[key] for key in keys), strict=True))
        return orders, Needles(second, skew)

    @property
    def count(self) -> int:
        """Number of different points."""
        return len(self._known)


def fitted(folder: Path, answers: Any) -> xr.Dataset:
    """The result of a fit, as the command makes it."""
    rig = FitProblem(load_fit(folder / "fit.toml"))
    model = Model(rig, answers)
    solution, error = rig.fit(model, lambda stage: None)
    return fit_dataset(rig, solution, error, next_record(rig, model, solution)).assign_attrs(points=model.count)


def half_width(result: xr.Dataset, name: str) -> float:
    """Half of an interval."""
    own = result.sel(unknown=name)
    return float(own["high"] - own["low"]) / 2


def one_rig(number: int, options: argparse.Namespace) -> dict[str, Any] | None:
    """Fit one rig; None where its joint has no answer at some point."""
    random = np.random.default_rng([options.seed, number])
    names = list(RANGES)[: 4 if "2" in options.orders.split(",") else 2]
    truth = hidden_joint(random, names)
    of_joint = np.random.default_rng([options.seed, number // options.draws, 1]) if options.draws else random
    points, known = operating_points(of_joint, options.records), known_joint(of_joint, options)
    joint = truth | known
    with TemporaryDirectory() as place:
        folder = Path(place)
        if not write_rig(folder, joint, points, number, options):
            return None
        (folder / "fit.toml").write_text(fit_text(names, options, number, known))
        started = time.process_time()
        result = fitted(folder, options.answers)
        row: dict[str, Any] = {"rig": number, "cpu_s": time.process_time() - started}
        row |= {"points": int(result.attrs["points"])}
        row |= {"scatter": float(result.attrs["scatter"]), "left_out": int(result["left_out"].sum())}
        if "model_error_factor" in result:
            row |= {f"factor_{int(one['order'])}": float(one) for one in result["model_error_factor"]}
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
            if write_rig(folder, joint, [*points, point], number, options):
                again = fitted(folder, options.answers)
                row["gained"] = half_width(again, names[1]) / half_width(result, names[1])
    return row


def held(rows: list[dict[str, Any]], name: str) -> str:
    """How many intervals hold, with the range in which 95 of 100 of such counts have their probability."""
    holds = [row[f"{name}_holds"] for row in rows]
    good, count = sum(holds), len(holds)
    low = 0.0 if good == 0 else beta.ppf(0.025, good, count - good + 1)
    high = 1.0 if good == count else beta.ppf(0.975, good + 1, count - good)
    return f"{good} of {count} hold ({100 * low:.0f} to {100 * high:.0f} %)"


def main() -> None:
    """Fit all rigs, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truth", default="kinetostatic", help="model of the hidden joints, or drawn")
    parser.add_argument("--model", default="kinetostatic", help="model that is fitted")
    parser.add_argument("--points", type=Path, help="file of the points of the hidden joints, which are computed once")
    parser.add_argument("--records", type=int, default=8, help="records of a rig")
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--draws", type=int, help="rigs of one geometry, by an interpolated model")
    parser.add_argument("--orders", default="2,3")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--next", action="store_true", help="measure the best candidate of each rig, too")
    parser.add_argument("--record", type=Path, help="CSV file of all rigs")
    options = parser.parse_args()
    options.hidden = HiddenOrders(options.points)
    options.answers = Between() if options.draws else computed
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
        verdicts = [row[f"{name}_verdict"] for row in rows]
        parts = [
            f"{word}: {held([row for row in rows if row[f'{name}_verdict'] == word], name)}"
            for word in dict.fromkeys(verdicts)
        ]
        print(f"{name}: {held(rows, name)}; {', '.join(parts)}")
    gained = np.array([row["gained"] / row["promised"] for row in rows if "gained" in row])
    if gained.size:
        print(f"gained over promised: median {np.median(gained):.3f}, {gained.min():.3f} to {gained.max():.3f}")
    print(f"CPU seconds a fit: median {np.median([row['cpu_s'] for row in rows]):.1f}")


if __name__ == "__main__":
    main()
