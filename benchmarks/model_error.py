"""Records the errors of the models, by which every answer states them: src/tripod_doe/joint/model_errors.csv.

    for study in rungs rungs_needles joint_angle speed_torque; do
        tripod-doe run studies/$study.toml --out results/$study
    done
    python benchmarks/model_error.py results/rungs results/rungs_needles results/joint_angle results/speed_torque

Each row is an operating point: what differs from the reference joint, and the third order of the balances relative to
that of the rollers, and of the rollers relative to that of the needles. A value is empty where one of the two did not
finish (mostly since the joint vibrates), was not run, or where the model above has a numerical error of its own of more
than 2 %, as far as its run reports.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pandas as pd
import xarray as xr

import tripod_doe as td
from tripod_doe.joint.model_error import RECORDED, STEPS
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.simulator import Outcome

SURE = 0.02
"""Largest relative numerical error of a model that others are compared with."""
POINT = [
    name
    for name, parameter in JOINT_PARAMETERS.items()
    if parameter.group != "numerics" and parameter.default is not None
]
"""Parameters that make an operating point; others follow from them."""


def runs(cube: xr.Dataset) -> pd.DataFrame:
    """All points that were run: what they set, and their third order with its numerical error, NaN if unfinished."""
    points = cube[["outcome", "thrust_amplitude"]].sel(order=3, drop=True)
    if "thrust_amplitude_error" in cube:
        points["numerical"] = cube["thrust_amplitude_error"].sel(order=3, drop=True) / points["thrust_amplitude"]
    table = points.to_dataframe().reset_index()
    table["finished"] = table["outcome"] == Outcome.FINISHED
    fixed = json.loads(cube.attrs["fixed_parameters"])
    for name, value in fixed.items():
        if name == "model" or (name in POINT and value != JOINT_PARAMETERS[name].default):
            table[name] = value
    return table[table["outcome"] != Outcome.NOT_RUN].reset_index(drop=True)


def record(cubes: list[xr.Dataset]) -> pd.DataFrame:
    """The table: every operating point with the errors of the models; of repeated runs the first counts."""
    whole = pd.concat([runs(cube) for cube in cubes], ignore_index=True)
    given = [name for name in POINT if name in whole]
    for name in given:
        whole[name] = whole[name].fillna(JOINT_PARAMETERS[name].default)
    found = {
        str(model): rows.drop_duplicates(given).set_index(given) for model, rows in whole.groupby("model", sort=False)
    }
    table = pd.DataFrame(index=whole.set_index(given).index.unique())
    for model, above in STEPS:
        reference = found[above].reindex(table.index)
        sure = reference["thrust_amplitude"].where(~(reference["numerical"] > SURE))
        table[model] = found[model]["thrust_amplitude"].reindex(table.index) / sure - 1
    for model in ("rollers", "needles"):
        table[f"{model}_finished"] = found[model]["finished"].astype(float).reindex(table.index)
    return table.reset_index()


def main(folders: list[Path]) -> None:
    """Write the table, with what it was made of."""
    cubes = [td.open_cube(folder) for folder in folders]
    sources = ", ".join(
        f"{cube.attrs['title']} (study {cube.attrs['study_hash']}, kernels {cube.attrs['kernel_source_hash']})"
        for cube in cubes
    )
    head = f"# made by benchmarks/model_error.py from {sources}\n"
    RECORDED.write_text(head + record(cubes).to_csv(index=False, float_format="%.6g"), encoding="utf-8")


if __name__ == "__main__":
    main([Path(word) for word in sys.argv[1:]])
