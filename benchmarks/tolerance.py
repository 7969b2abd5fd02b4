"""How often the chances that `tolerance` states for a real joint hold, and whether what it proposes keeps the limit.

    python benchmarks/tolerance.py [--points 16384] [--seeds 60] [--out DIR]

A joint of 29 needles is simulated with `kinetostatic` at many points under scatter; each seed draws some of them, and
what `tolerance` says of those is held against all of them.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.tolerance.narrower_scatter import scaled_weights
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.study.definition.distributions import scatter_density
from tripod_doe.study.definition.study_file_schema import parse_file

_FACTORS = {
    "groove_sliding_friction": (0.065, 0.006, 0.045, 0.085),
    "needle_sliding_friction": (0.04, 0.005, 0.025, 0.055),
    "torque_n_m": (150, 10, 110, 190),
    "pitch_radius_mm": (20.5, 0.03, 20.4, 20.6),
    "initial_skew_1_deg": (0, 0.15, -0.4, 0.4),
    "initial_skew_2_deg": (0, 0.15, -0.4, 0.4),
}
_COSTS = {"groove_sliding_friction": 5.0, "needle_sliding_friction": 3.0, "torque_n_m": 1.0}
_KEEP = 0.97
_DRAWN = (512, 2048)


def study(points: int) -> str:
    """The joint, its scatter, and how many points."""
    scatter = "\n".join(
        f'[factors.{name}]\ndistribution = "truncated-normal"\nmean = {mean}\nstd = {std}\nlow = {low}\nhigh = {high}'
        for name, (mean, std, low, high) in _FACTORS.items()
    )
    return (
        '[study]\nname = "Joint of 29 needles under scatter"\n[base]\njoint_angle_deg = 8\nspeed_rpm = 150\n'
        f"roller_radius_mm = 16\nneedle_count = 29\nneedle_pitch_diameter_mm = 18.6\n{scatter}\n[design]\n"
        f'kind = "latin-hypercube"\nsamples = {points}\nseed = 3\n[keep]\noutputs = ["thrust_amplitude"]\n'
    )


class Whole:
    """All points: chances there are taken as true."""

    def __init__(self, cube: xr.Dataset, limit: float) -> None:
        self.tables = parse_file(cube.attrs["study"], "the study").factors
        self.columns = {name: cube[name].values for name in self.tables}
        self.above = (cube["thrust_amplitude"].sel(order=3).values > limit).astype(float)

    def scaled(self, scales: dict[str, float]) -> float:
        """The chance with other scatters."""
        weights = np.ones(self.above.size)
        for name, scale in scales.items():
            if scale < 1:
                weights = weights * scaled_weights(self.tables[name], self.columns[name], np.array([scale]))[0]
        return float(weights @ self.above / weights.sum())

    def shifted(self, name: str, shift: float) -> float:
        """The chance with another nominal value."""
        density, x = scatter_density(self.tables[name]).density, self.columns[name]
        weights = density(x - shift) / density(x)
        return float(weights @ self.above / weights.sum())


def hits(result: xr.Dataset, whole: Whole) -> list[tuple[str, float]]:
    """What is stated, and whether it holds; NaN where nothing is stated."""
    found, wrong, names = [], 0, [str(name) for name in result["factor"].values]

    def add(what: str, part: xr.Dataset, way: str, truth: float) -> None:
        low, high = (float(part[f"exceedance_{way}_{end}"]) for end in ("low", "high"))
        found.append((what, float(low <= truth <= high) if np.isfinite(low + truth) else np.nan))

    for at, name in enumerate(names):
        one = result.isel(factor=at)
        add("chance if halved", one, "if_halved", whole.scaled({name: 0.5}))
        shift = float(one["shift_to_keep"])
        if np.isfinite(shift):
            truth = whole.shifted(name, shift)
            add("chance at a shift proposed", one, "at_shift", truth)
            wrong += truth > 1 - _KEEP
        for other, second in enumerate(names[: at + 1]):
            pair = result.isel(factor=at, factor_2=other)
            scale = float(pair["scale_to_keep"])
            if np.isfinite(scale):
                truth = whole.scaled({name: scale, second: scale})
                add("chance at a scale proposed", pair, "at_scale", truth)
                wrong += truth > 1 - _KEEP
    scales = dict(zip(names, result["cheapest_scale"].values.tolist(), strict=True))
    if np.isfinite(list(scales.values())).all():
        truth = whole.scaled(scales)
        add("chance at the cheapest scales", result, "at_cheapest", truth)
        wrong += truth > 1 - _KEEP
    return [*found, ("all that is proposed keeps the limit", float(wrong == 0))]


def main(arguments: list[str] | None = None) -> None:
    """Simulate the points, and print a line for each kind of statement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=16384)
    parser.add_argument("--seeds", type=int, default=60)
    parser.add_argument("--out", type=Path, default=Path("results/tolerance_benchmark"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "study.toml"
    file.write_text(study(options.points))
    td.run(file, out=options.out / "run")
    cube = td.open_cube(options.out / "run")
    cube = cube.isel(point=np.flatnonzero(cube["outcome"].values == 0)).load()
    limit = float(cube["thrust_amplitude"].sel(order=3).quantile(0.93))
    whole, collected = Whole(cube, limit), defaultdict(list)
    print(f"{cube.sizes['point']:,} points, of which 7 % exceed {limit:.4g} N")
    for seed in range(options.seeds):
        random = np.random.default_rng(seed)
        for drawn in _DRAWN:
            points = np.sort(random.choice(cube.sizes["point"], drawn, replace=False))
            settings = ToleranceSettings(limits={"thrust_amplitude_3": limit}, keep=_KEEP, costs=_COSTS, seed=seed)
            result = tolerance(cube.isel(point=points), settings).sel(order=3)
            for what, hit in hits(result, whole):
                collected[f"{drawn} points: {what}"].append(hit)
    for what, each in collected.items():
        stated = np.array(each)[np.isfinite(each)]
        print(f"{what:55} {100 * stated.mean():5.1f} % of {stated.size}")


if __name__ == "__main__":
    main()
