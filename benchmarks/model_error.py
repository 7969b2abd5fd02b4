"""Records the errors of the models, by which every answer states them: src/tripod_doe/joint/known_errors/model_errors.csv.

    studies="rungs_needles joint_angle speed_torque needles_field needles_reference needles_wide_field needles_fast_field needles_other_joints needles_large_angles needles_fast_small_angles rungs"
    for study in $studies; do
        tripod-doe run studies/$study.toml --out results/$study
    done
    cd results && python ../benchmarks/model_error.py $studies

`--add` keeps the rows that are there, and adds those of the studies that are named.

    python benchmarks/model_error.py --renew rollers     # kinetostatic, too: 3 s, rollers: 3 min

computes the models that are named, or both, anew beside the needles: `equilibrium`, which has not changed, gives the
third order that errors are relative to. Rows without needles stay as they are, relative to rollers as the kernels of
their study ran them.

Each row is an operating point: what differs from the reference joint, and the third order of the models relative to
that of the needles, or, where those were not run (`needles` is 0), to that of the rollers. The balances are run here,
and so are the rollers at points of the needles. Beside rollers, whose needles keep their skew, those of `kinetostatic`
do so, too: what needles do moves the third order by 2 % and more at two in five of such points. A value is empty where one of the two did not finish, where the joint
vibrates (vibrating_joints.py records what that makes of the third order), or where the run of the finer model has a
numerical error of more than 2 %, as far as it reports.
`inexact` is the relative numerical error of the run of the finer model; empty where it was not kept.
Columns with _2 hold the second order of a model over the third of the needles; they are empty where the second order of
the needles has a numerical error of more than 10 % of itself and of a hundredth of the third.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import tripod_doe as td
from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.known_errors.error_estimate import COMPARED, FINEST, RECORDED
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.mechanics.compilation.sources import source_hashes
from tripod_doe.model_interface import Outcome

SURE, SECOND_SURE = 0.02, 0.1
"""Largest relative numerical error of a run that others are compared with, of its third and second order."""
FLOOR = 0.01
"""Share of the third order that a smaller second one counts as."""
BUDGET = 60_000
"""Evaluations of a run of `rollers`, twenty times a usual one: a joint that vibrates by itself would take hundreds."""
_NOTHING = np.full(2, np.nan)
POINT = [
    name
    for name, parameter in JOINT_PARAMETERS.items()
    if parameter.group != "numerics" and parameter.default is not None
]
"""Parameters that make an operating point; others follow from them."""


def runs(cube: xr.Dataset) -> pd.DataFrame:
    """Points of a cube that were run with needles or rollers: what they set, and their third order, NaN if not sure."""
    points = cube[["outcome"]].assign(
        {
            f"{name}_{order}": cube[f"thrust_{name}"].sel(order=order, drop=True)
            for name in ("amplitude", "amplitude_error")
            for order in (2, 3)
        }
    )
    table = points.to_dataframe().reset_index()
    for name, value in json.loads(cube.attrs["fixed_parameters"]).items():
        if name == "model" or (name in POINT and value != JOINT_PARAMETERS[name].default):
            table[name] = value
    table = table[table["model"].isin([FINEST, "rollers"]) & (table["outcome"] != Outcome.NOT_RUN)]
    finished, direct = table["outcome"] == Outcome.FINISHED, table["model"] == FINEST
    third, second = table["amplitude_3"], table["amplitude_2"]
    table["reference"] = third.where(finished & (table["amplitude_error_3"] <= SURE * third))
    table["inexact"] = table["amplitude_error_3"] / table["reference"]
    known = table["amplitude_error_2"] <= SECOND_SURE * np.maximum(second, FLOOR * third)
    table[f"{FINEST}_2"] = (second / table["reference"]).where(direct & known)
    table["needles"] = direct.astype(int)
    return table.reset_index(drop=True)


def orders(model: str, point: dict[str, float], needles: bool) -> np.ndarray:
    """Second and third order of a model, NaN where it does not finish; beside `needles`, or beside rollers."""
    if model == "kinetostatic" and not needles:
        values = point_values({"relative_tolerance": 1e-6, **point})
        found = solve_kinetostatic(values, int(JOINT_PARAMETERS["samples_per_revolution"].default), needles_move=False)
        return np.abs(complex_amplitudes(found.groove_thrust.sum(axis=1)))[0, 2:4] if found.settled[0] else _NOTHING
    given = {"accuracy": 0.01, "evaluation_budget": BUDGET} if model == "rollers" else {}
    result = td.simulate(**point, model=model, **given)
    return result["thrust_amplitude"].sel(order=[2, 3]).values if result.attrs["finished"] else _NOTHING


def vibrates(point: dict[str, float]) -> bool:
    """Whether a joint vibrates by itself."""
    return growing_vibration(point_values(point).point(0)) is not None


def record(cubes: list[xr.Dataset]) -> pd.DataFrame:
    """The table: every operating point with the errors of the models; needles count first, and the first of them."""
    whole = pd.concat([runs(cube) for cube in cubes], ignore_index=True)
    given = [name for name in POINT if name in whole]
    for name in given:
        whole[name] = whole[name].fillna(JOINT_PARAMETERS[name].default)
    whole = whole.sort_values("needles", ascending=False, kind="stable")
    table = whole.drop_duplicates(given)[[*given, "needles", "reference", "inexact", f"{FINEST}_2"]].reset_index(
        drop=True
    )
    without = [vibrates(point) for point in table[given].to_dict("records")]
    table.loc[without, ["reference", "inexact", f"{FINEST}_2"]] = np.nan
    for model in COMPARED:
        asked = np.isfinite(table["reference"]) & ((table["needles"] == 1) | (model != "rollers"))
        found = [
            orders(model, row[given].to_dict(), row["needles"] == 1) / row["reference"] if asked[at] else _NOTHING
            for at, row in table.iterrows()
        ]
        second, third = np.array(found).T
        table[model], table[f"{model}_2"] = third - 1, np.where(table[f"{FINEST}_2"].notna(), second, np.nan)
        print(f"{model}: {table[model].notna().sum()} of {len(table)} points", flush=True)
    return table.drop(columns="reference")


def main(folders: list[Path], add: bool = False) -> None:
    """Write the table, or add to it, with what it was made of."""
    cubes = [td.open_cube(folder) for folder in folders]
    sources = ", ".join(
        f"{cube.attrs['title']} (study {cube.attrs['study_hash']}, kernels {cube.attrs['kernel_source_hash']})"
        for cube in cubes
    )
    made = f"kernels {source_hashes().kernels}, from {sources}"
    head, table = f"# made by benchmarks/model_error.py, {made}", record(cubes)
    if add:
        head = f"{RECORDED.read_text(encoding='utf-8').splitlines()[0]}; {made}"
        table = joined(pd.read_csv(RECORDED, comment="#"), table)
    _write(head, table)


def renewed(known: pd.DataFrame, models: list[str]) -> pd.DataFrame:
    """The record with some models as they are now beside needles; `equilibrium` tells what errors are relative to."""
    rows = known.index[(known["needles"] == 1) & known["equilibrium"].notna()]
    points = known.loc[rows, [name for name in POINT if name in known]]
    third = _balance("equilibrium", points)[:, 1]
    table, reference = known.copy(), third / (1 + known.loc[rows, "equilibrium"].to_numpy())
    for model in models:
        second, third = (_rollers(points) if model == "rollers" else _balance(model, points)).T / reference
        table.loc[rows, model] = third - 1
        table.loc[rows, f"{model}_2"] = np.where(known.loc[rows, f"{FINEST}_2"].notna(), second, np.nan)
    return table


def _balance(model: str, points: pd.DataFrame) -> np.ndarray:
    """Second and third order of a balance of forces, NaN where it does not finish, shape (point, 2)."""
    drawn = {name: points[name].to_numpy(float) for name in points}
    block = simulator.simulate(simulator.columns({"model": model}, drawn, len(points)), ("thrust_amplitude",))
    finished = (block.outcome == Outcome.FINISHED)[:, None]
    return np.where(finished, block.outputs["thrust_amplitude"].data[:, 2:4], np.nan)


def _rollers(points: pd.DataFrame) -> np.ndarray:
    """Second and third order of `rollers`, NaN where they do not finish or the joint vibrates, shape (point, 2)."""
    return np.array([_NOTHING if vibrates(row) else orders("rollers", row, True) for row in points.to_dict("records")])


def renew(models: list[str]) -> None:
    """Write the record with some models as they are now."""
    head, known = RECORDED.read_text(encoding="utf-8").splitlines()[0], pd.read_csv(RECORDED, comment="#")
    made = f"{' and '.join(models)} beside needles by kernels {source_hashes().kernels}"
    _write(f"{head}; {made}", renewed(known, models))


def _write(head: str, table: pd.DataFrame) -> None:
    RECORDED.write_text(f"{head}\n{table.to_csv(index=False, float_format='%.6g')}", encoding="utf-8")


def joined(known: pd.DataFrame, added: pd.DataFrame) -> pd.DataFrame:
    """Rows of both tables, those with needles first; what one of them does not vary has its default there."""
    order = [*dict.fromkeys(name for table in (known, added) for name in table if name in POINT)]
    order += [name for name in known if name not in POINT]
    whole = pd.concat([known, added], ignore_index=True)[order]
    filled = {name: JOINT_PARAMETERS[name].default for name in order if name in POINT}
    return whole.fillna(filled).sort_values("needles", ascending=False, kind="stable")


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word not in ("--add", "--renew")]
    if "--renew" in sys.argv:
        renew(words or ["kinetostatic", "rollers"])
    else:
        main([Path(word) for word in words], add="--add" in sys.argv)
