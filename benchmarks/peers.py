"""What a cheap point costs besides itself: tripod-doe, xyzpy, xsweep, EasyVVUQ and plain Dask on one grid, in one run.

    pip install xyzpy xsweep h5netcdf                 # beside tripod-doe
    python3 -m venv other; other/bin/pip install easyvvuq    # of its own: it needs NumPy 1
    python benchmarks/peers.py [--levels 200] [--only dask,xyzpy] [--python easyvvuq=other/bin/python]

A Python function of two numbers, called once for each point of a grid, in one process; each tool keeps the results in a
file of its usual kind, and gives them back as an array, which is compared. The price is CPU time of the process and all
that it starts, of the whole grid less that of a tenth of its levels, over the points between them: without imports.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

POINT = "def force(x, y):\n    return {'peak': x * y}\n"
STUDY = """
[study]
name = "peers"
function = "peer_point:force"
[factors]
x = {{low = 1, high = 2, count = {levels}}}
y = {{low = 3, high = 4, count = {levels}}}
"""


def peak(x, y):
    """The same for tools that want a number."""
    return x * y


def axes(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels of both factors."""
    return np.linspace(1, 2, levels), np.linspace(3, 4, levels)


def with_tripod_doe(folder: Path, levels: int) -> np.ndarray:
    """Journal, cube, costs and report."""
    import tripod_doe as td

    (folder / "peer_point.py").write_text(POINT)
    (folder / "study.toml").write_text(STUDY.format(levels=levels))
    td.run(folder / "study.toml", folder / "out", workers=0, progress=False)
    return td.open_cube(folder / "out")["peak"].values


def with_dask(folder: Path, levels: int) -> np.ndarray:
    """One delayed call a point on its threads, without a scheduler process; a netCDF file."""
    import dask
    import xarray as xr

    x, y = axes(levels)
    calls = [dask.delayed(peak)(one, other) for one in x.tolist() for other in y.tolist()]
    values = np.reshape(dask.compute(*calls, scheduler="threads", num_workers=1), (levels, levels))
    xr.Dataset({"peak": (("x", "y"), values)}, {"x": x, "y": y}).to_netcdf(folder / "peak.nc")
    return xr.load_dataset(folder / "peak.nc")["peak"].values


def with_xyzpy(folder: Path, levels: int) -> np.ndarray:
    """A harvester with its file."""
    import xyzpy

    x, y = axes(levels)
    harvester = xyzpy.Harvester(xyzpy.Runner(peak, var_names=["peak"]), data_name=str(folder / "peak.h5"))
    harvester.harvest_combos({"x": x.tolist(), "y": y.tolist()}, verbosity=0)
    return harvester.full_ds["peak"].transpose("x", "y").values


def with_xsweep(folder: Path, levels: int) -> np.ndarray:
    """A sweep with its store."""
    import xarray as xr
    import xsweep

    x, y = axes(levels)
    swept = xsweep.sweep("loop(x, y) -> peak()", store=str(folder / "peak.zarr"), version="1")(peak)
    found = swept(xr.Dataset({"x": ("x", x), "y": ("y", y)}))
    found = found["peak"] if isinstance(found, xr.Dataset) else found
    return found.transpose("x", "y").values


def with_easyvvuq(folder: Path, levels: int) -> np.ndarray:
    """A campaign with its database, its function called in this process."""
    import easyvvuq as uq

    x, y = axes(levels)
    params = {name: {"type": "float", "default": 1.0} for name in ("x", "y")}
    actions = uq.actions.Actions(uq.actions.ExecutePython(lambda point: {"peak": point["x"] * point["y"]}))
    campaign = uq.Campaign(name="peers", params=params, actions=actions, work_dir=str(folder))
    campaign.set_sampler(uq.sampling.BasicSweep({"x": x.tolist(), "y": y.tolist()}))
    campaign.execute(sequential=True).collate()
    table = campaign.get_collation_result()
    table.columns = [str(column[0] if isinstance(column, tuple) else column) for column in table.columns]
    return table.sort_values(["x", "y"])["peak"].to_numpy().reshape(levels, levels)


SWEEPS: dict[str, Callable[[Path, int], np.ndarray]] = {
    "tripod-doe": with_tripod_doe,
    "dask": with_dask,
    "xyzpy": with_xyzpy,
    "xsweep": with_xsweep,
    "easyvvuq": with_easyvvuq,
}


def checked(name: str, levels: int) -> None:
    """Sweep in a folder of its own, and hold the answer against the product."""
    x, y = axes(levels)
    with tempfile.TemporaryDirectory() as folder:
        np.testing.assert_allclose(SWEEPS[name](Path(folder), levels), x[:, None] * y, rtol=1e-15)


def cpu_seconds(name: str, levels: int, python: str) -> float:
    """CPU time of a sweep in a process of its own.

    Raises
    ------
    RuntimeError
        With the last line that it told, if it failed.
    """
    before: Any = os.times()
    words = [python, __file__, "--one", name, "--levels", str(levels)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no word"])[-1])
    after: Any = os.times()
    return float(after.children_user + after.children_system - before.children_user - before.children_system)


def main(arguments: list[str] | None = None) -> None:
    """Tell the price of a point with every tool."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--levels", type=int, default=200, help="of each of the two factors")
    words.add_argument("--only", default=",".join(SWEEPS))
    words.add_argument("--python", action="append", default=[], metavar="NAME=PATH", help="where a tool is installed")
    words.add_argument("--one", help=argparse.SUPPRESS)
    options = words.parse_args(arguments)
    if options.one:
        checked(options.one, options.levels)
        return
    pythons = dict(text.split("=", 1) for text in options.python)
    few = max(options.levels // 10, 1)
    for name in options.only.split(","):
        try:
            small, large = (cpu_seconds(name, n, pythons.get(name, sys.executable)) for n in (few, options.levels))
        except RuntimeError as error:
            print(f"{name:12} not measured: {error}", flush=True)
            continue
        price = (large - small) / (options.levels**2 - few**2)
        print(f"{name:12}{1e6 * price:10.1f} us/point, {small:.1f} CPU-s besides", flush=True)


if __name__ == "__main__":
    main()
