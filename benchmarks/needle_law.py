"""How well the law by which `kinetostatic` moves its needles answers: errors against the model with needles as bodies.

    tripod-doe run studies/needles_field.toml --out results/needles_field       # a quarter of an hour on one core
    python benchmarks/needle_law.py results/needles_field

Every point of the cube that finished is solved by `kinetostatic` with needles that keep their skew, by `kinetostatic` as
it is, and by `rollers`. The second order counts where it is above half a per cent of the third. What the runs of the
cube say of their own numerical error is told beside.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
import xarray as xr

import tripod_doe as td
from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.model_interface import Outcome

COUNTS = 0.005
"""Second order over the third above which it is compared."""
SAMPLES, TOLERANCE = 360, 1e-6
MODELS = ("kept skews", "kinetostatic", "rollers")


def operating_points(cube: xr.Dataset) -> list[dict[str, float]]:
    """What each point of a cube without a grid sets, numerics left out."""
    fixed = json.loads(cube.attrs["fixed_parameters"])
    known = [name for name, parameter in JOINT_PARAMETERS.items() if parameter.group != "numerics"]
    columns = {name: cube[name].values for name in known if name in cube}
    rest = {name: fixed[name] for name in known if name in fixed and name not in columns and fixed[name] is not None}
    return [rest | {name: float(column[i]) for name, column in columns.items()} for i in range(cube.sizes["point"])]


def of_balance(point: dict[str, float], move: bool) -> tuple[np.ndarray, np.ndarray, float]:
    """Complex orders, mean skews of the last two revolutions in deg, and CPU seconds."""
    values, began = point_values(point | {"relative_tolerance": TOLERANCE}), time.process_time()
    solution = solve_kinetostatic(values, SAMPLES, needles_move=move)
    spent = time.process_time() - began
    skews = np.array([point[f"initial_skew_{k}_deg"] for k in (1, 2, 3)])
    if move:
        skews = np.degrees(solution.needle_skew[0][:, -2 * SAMPLES :].mean(axis=1))
    orders = complex_amplitudes(solution.groove_thrust.sum(axis=1))[0]
    return np.where(solution.settled[0], orders, np.nan), skews, spent


def of_rollers(point: dict[str, float]) -> np.ndarray:
    """Complex orders."""
    result = td.simulate(**point, model="rollers")
    orders = result["thrust_amplitude"].values * np.exp(1j * np.radians(result["thrust_phase_deg"].values))
    return np.where(result.attrs["finished"], orders, np.nan)


def compare(cube: xr.Dataset) -> xr.Dataset:
    """Complex orders two and three of all models at the points that finished, and mean skews in deg."""
    cube = cube.isel(point=np.flatnonzero(cube["outcome"].values == Outcome.FINISHED))
    points, prices = operating_points(cube), []
    needles = (cube["thrust_amplitude"] * np.exp(1j * np.radians(cube["thrust_phase_deg"]))).values
    found, skews = {"needles": needles}, {"needles": cube["needle_skew_deg"].mean("rotation_deg").values}
    for model, move in (("kept skews", False), ("kinetostatic", True)):
        of_balance(points[0], move)  # compiled
        solved = [of_balance(point, move) for point in points]
        found[model], skews[model] = (np.array(column) for column in list(zip(*solved, strict=True))[:2])
        prices.append(1e3 * float(np.median([spent for *_, spent in solved])))
    found["rollers"] = np.array([of_rollers(point) for point in points])
    own = (cube["thrust_amplitude_error"] / cube["thrust_amplitude"]).sel(order=[2, 3]).values
    return xr.Dataset(
        {
            "orders": (("model", "point", "order"), np.stack([found[name][:, 2:4] for name in found])),
            "skew": (("model", "point", "trunnion"), np.stack([skews[name] for name in skews] + [skews["kept skews"]])),
            "own": (("point", "order"), own),
        },
        {"model": list(found), "order": [2, 3], "crown": ("point", [p["needle_crown_um"] for p in points])},
        {"prices": prices},
    )


def quantiles(errors: np.ndarray) -> str:
    """Median and ninth decile of the numbers."""
    known = np.abs(errors[np.isfinite(errors)])
    return f"{np.median(known):8.3g} ({np.quantile(known, 0.9):.3g})" if known.size else "       –"


def tell(found: xr.Dataset, title: str) -> None:
    """Print medians (ninth deciles) of all errors."""
    orders, needles = found["orders"], found["orders"].sel(model="needles")
    counts = (abs(needles.sel(order=2)) > COUNTS * abs(needles.sel(order=3))).values
    print(f"\n{title}: {orders.sizes['point']} points, of which the second order counts at {counts.sum()}")
    print(
        f"own error of needles, %: third {quantiles(100 * found['own'].sel(order=3).values)}, "
        f"second {quantiles(100 * found['own'].sel(order=2).values[counts])}"
    )
    print(f"{'':14s}{'third, %':>16s}{'second, %':>18s}{'its phase, deg':>18s}{'skew, deg':>18s}")
    for model in MODELS:
        ratio = (orders.sel(model=model) / needles).values
        apart = (found["skew"].sel(model=model) - found["skew"].sel(model="needles")).values
        columns = (
            100 * (abs(ratio[:, 1]) - 1),
            100 * (abs(ratio[counts, 0]) - 1),
            np.degrees(np.angle(ratio[counts, 0])),
            apart,
        )
        print(f"{model:14s}" + "  ".join(f"{quantiles(column.ravel()):>16s}" for column in columns))


def main() -> None:
    found = compare(td.open_cube(sys.argv[1]))
    crown = found["crown"].values
    tell(found, "all")
    tell(found.isel(point=crown <= np.median(crown)), f"crown up to {np.median(crown):.2g} um")
    tell(found.isel(point=crown > np.median(crown)), "more crown")
    print("\nprice, ms: kept skews {:.1f}, kinetostatic {:.1f}".format(*found.attrs["prices"]))


if __name__ == "__main__":
    main()
