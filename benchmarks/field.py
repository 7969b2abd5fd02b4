"""Does a model answer everywhere? Random points of the field in which a tripod joint is used: outcomes and prices.

    python benchmarks/field.py [MODEL] [--count 1000] [--seed 1] [--calm] [--against FACTOR] [--beside MODEL] [--plain]
                               [--rounding] [--held 40] [--record FILE]

Every point has operating conditions, frictions, skews and a geometry of its own, as far as the parts fit; every 25th is
a straight joint. `needles` have as many needles as fit. The balances have random mechanisms switched off. `--calm` stays near the paper's point instead: what
the field costs is compared with that. Points that did not finish are listed as arguments of `simulate`.

`--against 10` solves again with a tenth of the tolerance (of the accuracy, where runs find their tolerance) and tells
how far the orders moved, over the largest order of the thrust, and at how many points the third order was wrong by more
than 5 %; joints that were followed as vibrating are left to vibration.py, since their revolutions differ by chance.
`--beside kinetostatic` holds a balance against the runs of a multibody model at the points where both finish, and tells
at how many it is off by more than 5 % and more than the errors that both state. `--plain` tells the price beside that of a
run with one tolerance for all points, as runs were before they found their own. `--rounding` tells at how many points of a
balance the third order hangs on rounding: it spreads by more than 0.05 % where the torque changes by a relative 3e-15 to
2.1e-14. `--held` takes the first so many points only for these. Bounds are Clopper and Pearson's at 95 %.

`--record FILE` keeps every answer as a line of JSON. The same command goes on from there where it was stopped, also
with a larger count: the first points of a seed are the same whatever the count.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from tripod_doe.joint.accuracy import SMALLEST_THIRD
from tripod_doe.joint.geometry.feasibility import misfits, most_needles
from tripod_doe.joint.known_errors.error_estimate import known_errors
from tripod_doe.joint.models.multibody_run import follow
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.compilation.sources import source_hashes
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.model_interface import Outcome

FIELD = {
    "joint_angle_deg": (0.0, 20.0),
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
    "needle_axial_clearance_mm": (0.02, 0.5),
    "needle_crown_um": (0.0, 10.0),
}
"""Ranges of the field; torque of both signs."""
LARGEST_ANGLE = 25.0
"""Joint angle in deg up to which the balances are asked."""
CALM = {"joint_angle_deg": (5.0, 15.0), "torque_n_m": (25.0, 150.0), "speed_rpm": (300.0, 1000.0)}
GEOMETRY = (
    "pitch_radius_mm",
    "roller_radius_mm",
    "roller_width_mm",
    "needle_count",
    "needle_diameter_mm",
    "needle_length_mm",
    "needle_pitch_diameter_mm",
    "shaft_mass_kg",
)
"""Within 25 % of their defaults."""
SWITCHES = [name for name, parameter in JOINT_PARAMETERS.items() if parameter.kind == "switch"]
BALANCES = ("equilibrium", "kinetostatic")
STRAIGHT = 25
NO_THRUST = 1e-3
"""N; the orders of a straight joint are rounding."""
WRONG = 0.05
"""Relative error of the third order above which a point counts as wrong."""
HANGS = 5e-4
"""Relative spread of the third order above which a point hangs on rounding."""
_BATCH = 1000
_EVALUATIONS = 10**7


def field_points(count: int, rng: np.random.Generator, model: str = "kinetostatic") -> dict[str, np.ndarray]:
    """Columns of random points whose parts fit; for a balance with random switches and larger joint angles."""
    chosen: dict[str, np.ndarray] = {}
    ranges = FIELD | ({"joint_angle_deg": (0.0, LARGEST_ANGLE)} if model in BALANCES else {})
    while len(next(iter(chosen.values()), ())) < count:
        drawn = {name: rng.uniform(*limits, _BATCH) for name, limits in ranges.items()}
        drawn["torque_n_m"] *= rng.choice([-1, 1], _BATCH)
        drawn["joint_angle_deg"][::STRAIGHT] = 0.0
        for name in GEOMETRY:
            drawn[name] = JOINT_PARAMETERS[name].default * rng.uniform(0.75, 1.25, _BATCH)
        drawn["needle_count"] = np.round(drawn["needle_count"])
        if model == "needles":  # as bodies without a cage they would run together: no ring has such gaps
            drawn["needle_count"] = most_needles(drawn["needle_diameter_mm"], drawn["needle_pitch_diameter_mm"])
        drawn["groove_radius_ratio"] = 1 + 0.0086 * rng.uniform(0.75, 1.25, _BATCH)
        drawn |= {name: rng.integers(model not in BALANCES, 2, _BATCH).astype(float) for name in SWITCHES}
        full = all_columns(drawn)
        fits = np.ones(_BATCH, bool)
        fits[[row for row, _ in misfits(internal(full))]] = False
        chosen = {name: np.concatenate([chosen.get(name, column[:0]), column[fits]]) for name, column in drawn.items()}
    return {name: column[:count] for name, column in chosen.items()}


def calm_points(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of random points near the paper's."""
    return {name: rng.uniform(*limits, count) for name, limits in CALM.items()}


def all_columns(drawn: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every parameter of the joint."""
    return simulator.columns({}, drawn, len(drawn["torque_n_m"]))


def internal(columns: dict[str, np.ndarray]):
    """Values of a block of points."""
    return internal_values(columns)


class Answer(NamedTuple):
    """What became of one point: outcome, reason, CPU milliseconds, complex orders as pairs of numbers, and whether it
    was followed as vibrating."""

    outcome: int
    detail: str
    milliseconds: float
    orders: list[list[float]]
    vibrates: bool


class Record:
    """Answers of a field, kept in a file if there is one: a benchmark that is started again goes on where it stopped.

    Parameters
    ----------
    path
        The file; it holds a line on the field, then one for each answer.
    field
        What all answers have in common: those of another field are refused.
    """

    def __init__(self, path: Path | None = None, **field: Any) -> None:
        self._path, self._known, self._strange = path, dict[tuple[str, int], Answer](), 0
        if path is None:
            return
        lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        if not lines:
            self._write(field)
        elif lines[0] != field:
            raise SystemExit(f"{path}: holds answers of {lines[0]}, not of {field}")
        for way, row, sources, *answer in lines[1:]:
            self._known[way, row] = Answer(*answer)
            self._strange += sources != source_hashes().results

    def answer(self, way: str, row: int, found: Callable[[], Answer]) -> Answer:
        """The answer of a point in one way, from the file or found now."""
        if (way, row) not in self._known:
            self._known[way, row] = found()
            self._write([way, row, source_hashes().results, *self._known[way, row]])
        return self._known[way, row]

    def tell(self) -> None:
        """Print how many answers are those of other sources."""
        if self._strange:
            print(f"{self._strange} of these answers were found by other sources of this package")

    def _write(self, line: Any) -> None:
        if self._path:
            with self._path.open("a") as file:
                file.write(json.dumps(line) + "\n")


def answers(
    model: str,
    columns: dict[str, np.ndarray],
    factor: float = 1.0,
    record: Record | None = None,
    rows: Iterable[int] | None = None,
):
    """Outcome, reason, CPU milliseconds, complex orders of each point, by a `factor` of its tolerance or accuracy; and
    whether it was followed as vibrating.

    Parameters
    ----------
    record, rows
        Where answers are kept, by these numbers of the points; their own unless given.
    """
    solver, full, record = MODELS[model], all_columns(columns), record or Record()
    method, numerics = next(iter(solver.methods.items()))
    if solver.settles:
        full["accuracy"] = factor * full["accuracy"]
    else:
        full["relative_tolerance"] = np.full_like(full["accuracy"], factor * numerics["relative_tolerance"])
    values, found = internal(full), []
    solver.prepare(values.take([0]), method)
    for i, row in enumerate(range(values.torque.size) if rows is None else rows):
        found.append(record.answer(f"{model} {factor:g}", int(row), lambda at=i: _solved(model, values.take([at]))))
        if solver.settles:
            one = found[-1]
            print(
                f"  {row}: {Outcome(one.outcome).label}, {one.milliseconds:.0f} ms, {np.hypot(*one.orders[3]):.4g} N "
                f"{one.detail}",
                flush=True,
            )
    orders = np.array([one.orders for one in found])
    return (
        np.array([one.outcome for one in found]),
        [one.detail for one in found],
        np.array([one.milliseconds for one in found]),
        orders[..., 0] + 1j * orders[..., 1],
        np.array([one.vibrates for one in found]),
    )


def _solved(model: str, point) -> Answer:
    """Solve a block of one point by a model's own method."""
    solver, began = MODELS[model], time.process_time()
    keep = {"thrust_amplitude", "thrust_phase_deg", "vibration_growth_rate_per_s"} & solver.outputs
    block = solver.simulate(point, next(iter(solver.methods)), 360, keep)
    milliseconds = 1e3 * (time.process_time() - began)
    found = {name: block.outputs[name].data[0] if block.outputs else np.full(13, np.nan) for name in sorted(keep)}
    orders = found["thrust_amplitude"] * np.exp(1j * np.radians(found["thrust_phase_deg"]))
    pairs = [[each.real, each.imag] for each in orders]
    vibrates = bool(np.any(found.get("vibration_growth_rate_per_s", 0.0)))
    return Answer(int(block.outcome[0]), block.detail[0], milliseconds, pairs, vibrates)


def plain_prices(model: str, columns: dict[str, np.ndarray], record: Record) -> np.ndarray:
    """CPU milliseconds of a run with one tolerance for all points, after the question whether the joint vibrates."""
    values, (method, numerics) = internal(all_columns(columns)), next(iter(MODELS[model].methods.items()))
    settings = Settings(tolerance=numerics["relative_tolerance"], budget=_EVALUATIONS)

    def followed(row: int) -> Answer:
        point, began = values.point(row), time.process_time()
        growing_vibration(point)
        result, _ = follow(assemble(build_joint(point, model == "needles")), point, method, 360, None, settings)
        return Answer(int(result.outcome), result.detail, 1e3 * (time.process_time() - began), [], False)

    rows = range(values.torque.size)
    return np.array([record.answer(f"plain {model}", row, lambda at=row: followed(at)).milliseconds for row in rows])


def upper_bound(hits: int, runs: int) -> float:
    """Clopper and Pearson's upper bound of a rate, at 95 %."""
    return 1.0 if hits == runs else float(beta.ppf(0.95, hits + 1, runs - hits))


def tell(columns: dict[str, np.ndarray], outcome: np.ndarray, detail, price: np.ndarray, listed: int) -> None:
    """Print outcomes with their reasons, prices, and some points that did not finish."""
    not_finished = int((outcome != Outcome.FINISHED).sum())
    least = 100 * (1 - upper_bound(not_finished, outcome.size))
    print(f"finished {outcome.size - not_finished} of {outcome.size}: at least {least:.2f} %")
    for (number, text), times in Counter(zip(outcome.tolist(), detail, strict=True)).most_common():
        print(f"{times:6d} {100 * times / outcome.size:7.3f} %  {Outcome(number).label}  {text}")
    low, middle, high = np.quantile(price, (0.25, 0.5, 0.75))
    print(
        f"price: median {middle:.2f} ms ({low:.2f} to {high:.2f}), mean {price.mean():.2f}, "
        f"largest {price.max():.1f} ms, {price.max() / middle:.0f} medians"
    )
    for row in np.flatnonzero(outcome != Outcome.FINISHED)[:listed]:
        print(" ", " ".join(f"--{name} {column[row]:.17g}" for name, column in columns.items()))


def moved(orders: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Largest change of any order of each point, over the largest order."""
    return np.abs(orders - reference).max(axis=1) / np.maximum(np.abs(reference).max(axis=1), NO_THRUST)


def thirds(columns: dict[str, np.ndarray], orders: np.ndarray) -> np.ndarray:
    """Sizes that errors of the third order are relative to."""
    least = SMALLEST_THIRD * np.abs(columns["torque_n_m"]) / columns["pitch_radius_mm"] * 1e3
    return np.maximum(np.abs(orders[:, 3]), least)


def tell_against(columns: dict[str, np.ndarray], orders: np.ndarray, reference: np.ndarray, what: str) -> None:
    """Print how far orders are from those of a reference."""
    change = moved(orders, reference)
    wrong = np.abs(np.abs(orders[:, 3]) - np.abs(reference[:, 3])) > WRONG * thirds(columns, reference)
    print(
        f"against {what}, {len(orders)} points: median change of an order {np.median(change):.1e} of the largest, "
        f"worst {change.max():.1e}; third order wrong by more than 5 %: {wrong.sum()}, "
        f"at most {100 * upper_bound(int(wrong.sum()), wrong.size):.2g} %"
    )


def tell_rounding(model: str, columns: dict[str, np.ndarray], orders: np.ndarray, rows: np.ndarray) -> None:
    """Print at how many points of a balance the third order spreads where the torque changes by rounding."""
    sizes, solver = [np.abs(orders[:, 3])], MODELS[model]
    method, numerics = next(iter(solver.methods.items()))
    for k in range(1, 8):
        full = all_columns(columns | {"torque_n_m": columns["torque_n_m"] * (1 + k * 3e-15)})
        full["relative_tolerance"] = np.full_like(full["accuracy"], numerics["relative_tolerance"])
        block = solver.simulate(internal(full), method, 360, {"thrust_amplitude"})
        sizes.append(block.outputs["thrust_amplitude"].data[:, 3])
    spread = np.ptp(sizes, axis=0) / thirds(columns, orders)
    hang = np.flatnonzero(spread > HANGS)
    print(
        f"third order hangs on rounding at {hang.size} of {rows.size} points; largest spread {100 * spread.max():.2g} %"
    )
    for at in hang:
        print(f"  point {rows[at]}: spread {100 * spread[at]:.2g} %")


def tell_beside(
    model: str, beside: str, columns: dict[str, np.ndarray], reference: np.ndarray, record: Record, rows: np.ndarray
) -> None:
    """Print how far a balance is from runs of another model, beside the error that it states."""
    outcome, _, _, orders, _ = answers(model, columns, record=record, rows=rows)
    own = np.flatnonzero(outcome == Outcome.FINISHED)
    columns, size = {name: column[own] for name, column in columns.items()}, thirds(columns, reference)[own]
    error = np.abs(np.abs(orders[own, 3]) - np.abs(reference[own, 3])) / size
    _, limit, unknown = known_errors(model, all_columns(columns))
    limit = limit + np.nan_to_num(known_errors(beside, all_columns(columns))[1])
    told, off = unknown == "", error > WRONG
    beyond = off & told & (error > limit)
    print(
        f"{model} beside {beside}, {own.size} points: off by {100 * np.median(error):.2g} % in the median, "
        f"by more than 5 % at {off.sum()}; of {told.sum()} points with a stated error "
        f"{beyond.sum()} are off by more than 5 % and more than the limits of both"
    )
    for at in np.flatnonzero(beyond):
        print(f"  point {rows[own[at]]}: off by {100 * error[at]:.2g} %, limit {100 * limit[at]:.2g} %")


def main(given: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="kinetostatic", choices=tuple(MODELS))
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true")
    parser.add_argument("--against", type=float, metavar="FACTOR")
    parser.add_argument("--beside", choices=BALANCES)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--rounding", action="store_true")
    parser.add_argument("--held", type=int, metavar="COUNT")
    parser.add_argument("--record", type=Path, metavar="FILE")
    parser.add_argument("--listed", type=int, default=3)
    arguments = parser.parse_args(given)
    rng, model = np.random.default_rng(arguments.seed), arguments.model
    columns = calm_points(arguments.count, rng) if arguments.calm else field_points(arguments.count, rng, model)
    record = Record(arguments.record, model=model, seed=arguments.seed, calm=arguments.calm)
    outcome, detail, price, orders, vibrates = answers(model, columns, record=record)
    tell(columns, outcome, detail, price, arguments.listed)
    held = slice(0, arguments.held)
    columns, outcome, orders = {n: c[held] for n, c in columns.items()}, outcome[held], orders[held]
    finished = outcome == Outcome.FINISHED
    if vibrates.any():
        print(
            f"{vibrates.sum()} vibrate, and make {100 * price[vibrates].sum() / price.sum():.0f} % of the price; mean of "
            f"the others {price[~vibrates].mean():.2f} ms"
        )
    if arguments.plain:
        ratio = price[held].mean() / plain_prices(model, columns, record).mean()
        print(f"mean price {ratio:.2f} times that with one tolerance, {outcome.size} points")
    if arguments.against:
        rows = np.flatnonzero(finished & ~vibrates[held])
        asked = {n: c[rows] for n, c in columns.items()}
        tight, _, _, reference, _ = answers(model, asked, 1 / arguments.against, record, rows)
        both = tight == Outcome.FINISHED
        what = f"{'an accuracy' if MODELS[model].settles else 'a tolerance'} {arguments.against:g} times smaller"
        tell_against({n: c[both] for n, c in asked.items()}, orders[rows][both], reference[both], what)
    if arguments.rounding:
        rows = np.flatnonzero(finished)
        tell_rounding(model, {n: c[rows] for n, c in columns.items()}, orders[rows], rows)
    if arguments.beside:
        rows = np.flatnonzero(finished)
        tell_beside(arguments.beside, model, {n: c[rows] for n, c in columns.items()}, orders[rows], record, rows)
    record.tell()


if __name__ == "__main__":
    main()
