"""What `model = "auto"` saves and what it costs in accuracy, against the full model everywhere.

    python benchmarks/auto.py OUT [STUDY...]        # studies/auto_map.toml, auto_mixed.toml, auto_skew.toml

Runs each study, then the reference candidate of its pilot at all its points, or at a random part of them (`CHECKED`), and
tells in how many of these points the accuracy is met and what both cost. OUT keeps everything: run again, and only
what is missing runs. One worker, so that CPU seconds are those of a core; 40 minutes in all.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import xarray as xr

import tripod_doe as td
from tripod_doe.study.designs import make_points
from tripod_doe.workflow.definition import fed_study

STUDIES = Path(__file__).parent.parent / "studies"
NAMES = ("auto_mixed", "auto_map", "auto_skew")
CHECKED = 64  # points of a study that are compared: none of so many off is below 5 % of all, at 95 %


def reference_study(study: td.Study, choice: xr.Dataset, chosen: np.ndarray) -> td.Study:
    """The last candidate of the pilot at some points of the study."""
    points = make_points(study)
    last = int(choice.sizes["candidate_number"]) - 1
    candidate = next(r for r in study.accuracy.candidates if r.label == str(choice["candidate_label"].values[last]))
    table = {name: ("point", column[chosen]) for name, column in points.columns.items()}
    table |= {name: ("point", np.array([value] * chosen.size)) for name, value in candidate.values.items()}
    return fed_study(study, xr.Dataset(table), "reference")


def compare(name: str, out: Path) -> dict[str, object]:
    study = td.load_study(STUDIES / f"{name}.toml")
    td.run(study, out / name, workers=1)
    auto = td.open_cube(out / name)
    choice = xr.open_dataset(out / name / "choice.nc").load()
    count = int(auto["outcome"].size)
    chosen = np.sort(np.random.default_rng(0).permutation(count)[:CHECKED])
    td.run(reference_study(study, choice, chosen), out / f"{name}_reference", workers=1)
    reference = td.open_cube(out / f"{name}_reference")
    pilot = td.open_cube(out / name / "pilot")
    result: dict[str, object] = {"study": name, "points": count, "checked": int(chosen.size)}
    for demand in study.accuracy.demands:
        orders = auto[demand.output].values.reshape(count, -1)[chosen]
        full = reference[demand.output].values
        size = np.maximum(full[:, demand.label], study.accuracy.floor * full[:, 1:].max(axis=1))
        error = np.abs(orders[:, demand.label] - full[:, demand.label]) / size
        known = np.isfinite(error)
        estimate = auto[f"{demand.name}_error_estimate"].values.reshape(-1)[chosen]
        result[demand.name] = {
            "allowed": demand.allowed, "met": float((error[known] <= demand.allowed).mean()),
            "compared": int(known.sum()), "median_error": float(np.median(error[known])),
            "largest_error": float(error[known].max()), "estimate_covers": float((error <= estimate)[known].mean()),
        }  # fmt: skip
    result["candidates"] = {
        str(label): int(n)
        for label, n in zip(choice["candidate_label"].values, choice["points_of_candidate"].values, strict=True)
    }
    result["expected_not_met"] = int((choice["accuracy_met"] == 0).sum())
    result |= {key: float(choice.attrs[key]) for key in ("limit", "misses")}
    own = auto["cpu_seconds"].where(auto["from_pilot"] == 0, 0)
    every_point = float(choice["price"].values[choice["candidate"].values].sum())
    result["points_from_pilot"] = int(auto["from_pilot"].sum())
    result["cpu_seconds"] = spent(
        float(auto["cpu_seconds"].sum()), float(own.sum()), float(pilot["cpu_seconds"].sum()),
        float(reference["cpu_seconds"].mean()) * count,
    )  # fmt: skip
    prices = (float(choice.attrs[f"price_{key}_s"]) for key in ("study", "pilot", "reference"))
    result["estimated_cpu_seconds"] = spent(every_point, *prices)
    return result


def spent(points: float, study: float, pilot: float, reference: float) -> dict[str, float]:
    """Prices of all points with their chosen models, of those that the pilot did not run, of pilot and reference."""
    return {
        "points": points, "study": study, "pilot": pilot, "reference_everywhere": reference,
        "cheaper_without_pilot": reference / points, "cheaper_with_pilot": reference / (study + pilot),
    }  # fmt: skip


def main() -> None:
    out, names = Path(sys.argv[1]), sys.argv[2:] or NAMES
    for name in names:
        result = compare(name, out)
        print(json.dumps(result, indent=1), flush=True)
        (out / f"{name}.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
