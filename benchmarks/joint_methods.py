"""Error against CPU time of the time integration methods on the full joint, side by side in one run.

    python benchmarks/joint_methods.py [--model needles|rollers] [--explicit] [--out benchmarks/charts]

Every run is one of `tripod-doe simulate` (four revolutions, warm, one core, with its own checks and error estimate). Errors
are those of the second and third order of the thrust against adaptive-euler at a tolerance of 2.5e-4; how far that can
be trusted is what another method at a fine step differs by: BDF2 at 5e-6 s (rollers; with needles it does not converge
to its tolerance) and, with `--explicit`, symplectic Euler at 1e-7 s at the reference point, which takes minutes.
"""

from __future__ import annotations

import argparse
import csv
import itertools
from pathlib import Path

import matplotlib
import numpy as np

import tripod_doe as td

matplotlib.use("Agg")
import matplotlib.pyplot as plt

POINTS = ((5, 25), (5, 100), (10, 50), (15, 25), (15, 100))
SKEW = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}
SWEEP = {
    "adaptive-euler": ("relative_tolerance", (5e-3, 3e-3, 2e-3, 1e-3, 5e-4)),
    "linearly-implicit-euler": ("step_s", (4e-5, 2e-5, 1e-5, 5e-6)),
    "bdf2": ("step_s", (4e-5, 2e-5)),
    "implicit-euler": ("step_s", (2e-5,)),
    "generalized-alpha": ("step_s", (2e-5,)),
    "rosenbrock": ("relative_tolerance", (1e-3,)),
}
REFERENCE = {"method": "adaptive-euler", "relative_tolerance": 2.5e-4}


def simulate(point, model, **numerics):
    angle, torque = point
    result = td.simulate(model=model, joint_angle_deg=angle, torque_n_m=torque, **SKEW, **numerics)
    amplitudes = result.thrust_amplitude.values[2:4] if result.finished else np.full(2, np.nan)
    return str(result.outcome_detail.values), amplitudes, result.cost["cpu_seconds"]


def rows_of(point, model, explicit: bool):
    _, reference, _ = simulate(point, model, **REFERENCE)
    print(f"{point}: second {reference[0]:.4f} N, third {reference[1]:.4f} N", flush=True)
    if model == "rollers":
        yield measured(point, model, reference, "bdf2", step_s=5e-6)
    cases = [(m, name, value) for m, (name, values) in SWEEP.items() for value in values]
    for method, name, value in cases:
        yield measured(point, model, reference, method, **{name: value})
    if explicit and point == (10, 50):
        yield measured(point, model, reference, "symplectic-euler", step_s=1e-7)


def measured(point, model, reference, method, **numerics):
    detail, amplitudes, seconds = simulate(point, model, method=method, **numerics)
    errors = 100 * (amplitudes / reference - 1)
    setting = next(iter(numerics.values()))
    print(
        f"{point} {method:24s} {setting:8.1e} {seconds:8.2f} s  second {errors[0]:+7.2f} %  third "
        f"{errors[1]:+7.3f} %  {detail}",
        flush=True,
    )
    return (*point, method, setting, seconds, *errors, detail)


def chart(rows, out: Path) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharex=True)
    for axis, column, title in zip(axes, (6, 5), ("third order", "second order"), strict=True):
        for method, group in itertools.groupby(rows, key=lambda row: row[2]):
            chosen = [row for row in group if np.isfinite(row[column])]
            seconds, errors = [row[4] for row in chosen], [max(abs(row[column]), 1e-3) for row in chosen]
            axis.loglog(seconds, errors, "o", label=method, alpha=0.7)
        axis.set(title=f"{title} of the thrust", xlabel="CPU seconds a run", ylabel="error, %")
        axis.axhline(0.5 if column == 6 else 3.0, color="0.6", lw=1)
    axes[0].legend(frameon=False)
    figure.savefig(out)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="needles", choices=("needles", "rollers"))
    parser.add_argument("--explicit", action="store_true")
    parser.add_argument("--points", type=int, default=len(POINTS))
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "charts")
    arguments = parser.parse_args()
    points = ((10, 50), *(point for point in POINTS if point != (10, 50)))[: arguments.points]
    simulate(points[0], arguments.model, relative_tolerance=5e-3)
    rows = [row for point in points for row in rows_of(point, arguments.model, arguments.explicit)]
    arguments.out.mkdir(exist_ok=True)
    with open(arguments.out / f"joint_{arguments.model}.csv", "w", newline="") as file:
        names = ("joint_angle_deg", "torque_n_m", "method", "setting", "cpu_seconds", "second_%", "third_%", "detail")
        csv.writer(file).writerows([names, *rows])
    chart(sorted(rows, key=lambda row: row[2]), arguments.out / f"joint_{arguments.model}.svg")


if __name__ == "__main__":
    main()
