"""How the errors of `kinetostatic` against `needles` hang together between the records of a joint.

Joints and operating points are those of benchmarks/fit.py. The errors of the second order are held against what the skew
gives at each groove (`kept`) and what the turning of the needles since the start has added (`turned`), those of the third
against the order itself, and the likelihoods of ways in which they may hang together are compared: in proportion to the
order, alone, alike at all records of a joint, and alike at similar joint angles. `fit` counts what this finds
(analyses/fit/model_error.py).

Run as: python benchmarks/errors_between_records.py --record needles.jsonl [--seed 1] [--first 20] [--rigs 20]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import fit as rigs
import numpy as np
from scipy.optimize import minimize

import tripod_doe as td


@dataclass(frozen=True)
class Joint:
    """Errors at the points of one joint."""

    second: np.ndarray  # error of the second order, N, shape (point,)
    kept: np.ndarray  # second order at each groove, N, shape (point, groove)
    turned: np.ndarray  # what turning has added to it, N, shape (point, groove)
    third: np.ndarray  # relative error of the third order, shape (point,)
    angle: np.ndarray  # logarithm of the joint angle, shape (point,)


def joint(number: int, options: argparse.Namespace, hidden: rigs.HiddenOrders) -> Joint | None:
    """Errors of one joint; None where a point has no answer."""
    random = np.random.default_rng([options.seed, number])
    truth = rigs.hidden_joint(random, list(rigs.RANGES))
    points = rigs.operating_points(random)
    base = truth | rigs.known_joint(random, options)
    initial = np.array([truth["initial_skew_1_deg"], truth["initial_skew_2_deg"], 0.0])
    rows = []
    for values in points:
        point = base | dict(zip(rigs.make_rig.OPERATING, values, strict=True))
        fine, answer = hidden({"model": "needles", **point}), td.simulate(**point)
        if fine is None or "thrust_amplitude" not in answer:
            return None
        phase = np.exp(1j * np.radians(answer["thrust_phase_deg"].values))
        cheap = answer["thrust_amplitude"].values * phase
        at_groove = np.exp(1j * np.radians(answer["groove_thrust_phase_deg"].values[:, 2]))
        kept = answer["groove_thrust_amplitude"].values[:, 2] * at_groove
        skew = answer["needle_skew_summary_deg"].values[:, -1, 0]
        each = (kept * np.conj(rigs.AHEAD) * skew).sum() / (skew**2).sum()
        turn = np.exp(-1j * np.angle(fine[3] / cheap[3]) / 3)  # records are aligned by their third orders
        rows.append(
            (
                fine[2] * turn**2 - cheap[2],
                kept,
                each * rigs.AHEAD * (skew - initial),
                fine[3] / cheap[3] - 1,
                np.log(values[0]),
            )
        )
    return Joint(*(np.array(column) for column in zip(*rows, strict=True)))


def cost(free: np.ndarray, joints: list[Joint], order: int, way: str) -> float:
    """Minus the logarithm of the likelihood of errors with some deviations, whose logarithms are given."""
    size, total = np.exp(free), 0.0
    for one in joints:
        apart = np.subtract.outer(one.angle, one.angle)
        alike = {"alone": np.eye(one.angle.size), "all": np.ones_like(apart)}.get(
            way, np.exp(-((apart / size[-1]) ** 2) / 2)
        )
        if order == 3:
            error, parts = one.third, [np.ones((one.angle.size, 1))]
        else:
            error, parts = one.second, [one.kept, one.turned]
        if way == "order":
            whole = size[0] ** 2 * np.diag(np.abs(one.kept.sum(axis=1)) ** 2)
        else:
            count = len(parts)
            whole = np.diag(sum(size[at] ** 2 * (np.abs(part) ** 2).sum(axis=1) for at, part in enumerate(parts)))
            if way != "alone":
                shared = sum(size[count + at] ** 2 * part @ part.conj().T for at, part in enumerate(parts))
                whole = whole + alike * shared
        total += np.linalg.slogdet(whole)[1] + (error.conj() @ np.linalg.solve(whole, error)).real
    return float(total)


def main() -> None:
    """Compare the ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--record", type=Path, required=True, help="file of the points by needles, which are computed once"
    )
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.truth, options.model = "needles", "kinetostatic"
    hidden = rigs.HiddenOrders(options.record)
    every = (joint(number, options, hidden) for number in range(options.first, options.first + options.rigs))
    joints = [one for one in every if one is not None]
    print(f"{len(joints)} joints, {sum(one.angle.size for one in joints)} points; deviations of complex errors")
    for order, ways in ((2, ("order", "alone", "all", "angle")), (3, ("alone", "all", "angle"))):
        for way in ways:
            parts = 1 if way == "order" else (2 if order == 2 else 1) * (1 if way == "alone" else 2)
            start = np.array([-2.0 if order == 2 else -5.0] * parts + [-1.5] * (way == "angle"))
            best = minimize(cost, start, (joints, order, way), method="Nelder-Mead", options={"maxiter": 4000})
            values = ", ".join(f"{value:.3g}" for value in np.exp(best.x))
            print(f"order {order}, {way}: logarithm of the likelihood {-best.fun:.1f}; {values}", flush=True)


if __name__ == "__main__":
    main()
