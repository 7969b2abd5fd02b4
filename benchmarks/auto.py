"""What `model = "auto"` saves and what it costs in accuracy, against the full model everywhere.

    python benchmarks/auto.py OUT [STUDY...] [--checked 64]     # auto_mixed, auto_map and auto_skew of studies/, or files

Runs each study, then the finest candidate of its pilot at a random part of its points, and tells at which share of them
the accuracy is met, and what both cost by counted work. The check has a numerical error of its own: it is told, and the
share among those points at which it is within the accuracy itself. OUT keeps everything: run again, and only what is
missing runs. One worker; 30 minutes in all.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import xarray as xr

import tripod_doe as td
from tripod_doe.model_interface import Outcome, Quantity
from tripod_doe.study.designs import make_points
from tripod_doe.workflow.workflow import fed_study

STUDIES = Path(__file__).parent.parent / "studies"
NAMES = ("auto_mixed", "auto_map", "auto_skew")
CHECKED = 64  # points of a study that are compared: none of so many off is below 5 % of all, at 95 %


def full_model(study: td.Study, choice: xr.Dataset, chosen: np.ndarray) -> td.Study:
    """The finest candidate that ran in the pilot, at some points of the study."""
    points = make_points(study)
    finest = str(choice["candidate_label"].values[-1])
    candidate = next(each for each in study.auto_model.candidates if each.label == finest)
    table = {name: ("point", column[chosen]) for name, column in points.columns.items()}
    table |= {name: ("point", np.array([value] * chosen.size)) for name, value in candidate.values.items()}
    return fed_study(study, xr.Dataset(table), "full")


def numbers(cube: xr.Dataset, name: str, quantity: Quantity) -> tuple[np.ndarray, np.ndarray]:
    """A quantity at every point, and the largest one beside it."""
    values = cube[name].values.reshape(cube["outcome"].size, -1)
    if quantity.label is None:
        return values[:, 0], np.abs(values[:, 0])
    return values[:, quantity.label], np.abs(values[:, 1:]).max(axis=1)


def errors(auto: xr.Dataset, full: xr.Dataset, chosen: np.ndarray, quantity: Quantity, floor: float) -> np.ndarray:
    """Error of every compared point, and of the full model there, over the allowed one, shape (2, point)."""
    exact, largest = numbers(full, quantity.output, quantity)
    size = quantity.allowed * np.maximum(np.abs(exact), floor * largest)
    missed = np.abs(numbers(auto, quantity.output, quantity)[0][chosen] - exact) / size
    own = numbers(full, quantity.error, quantity)[0] / size
    finished = (full["outcome"].values == Outcome.FINISHED) & np.isfinite(missed)
    return np.stack([missed, own])[:, finished]


def told(found: np.ndarray, allowed: float) -> dict[str, object]:
    """Errors (see `errors`) in numbers: shares within the accuracy, errors themselves, and those of the check."""
    missed, own = found
    sure = own <= 1

    def percent(parts: np.ndarray) -> list[float]:
        return [round(100 * allowed * float(part), 2) for part in parts]

    return {
        "allowed_percent": 100 * allowed,
        "compared": missed.size,
        "met": int((missed <= 1).sum()),
        "sure": int(sure.sum()),
        "met_where_sure": int((missed[sure] <= 1).sum()),
        "error_percent_median_most": percent(np.quantile(missed, [0.5, 1.0])),
        "missed_percent": percent(np.sort(missed[missed > 1])),
        "error_of_check_percent_median_most": percent(np.quantile(own, [0.5, 1.0])),
    }


def compare(path: Path, out: Path, checked: int, workers: int = 1) -> dict[str, object]:
    """A study and the full model at some of its points, in numbers."""
    study, folder = td.load_study(path), out / path.stem
    td.run(study, folder, workers=workers)
    auto, choice = td.open_cube(folder), xr.open_dataset(folder / "choice.nc").load()
    count = int(auto["outcome"].size)
    chosen = np.sort(np.random.default_rng(0).permutation(count)[:checked])
    td.run(full_model(study, choice, chosen), out / f"{path.stem}_full", workers=workers)
    full = td.open_cube(out / f"{path.stem}_full")
    price = {key: float(choice.attrs[f"price_{key}_s"]) for key in ("study", "pilot", "reference")}
    everywhere = float(choice["price"].values[choice["candidate"].values].sum())
    points = zip(choice["candidate_label"].values, choice["points_of_candidate"].values, strict=True)
    return {
        "study": path.stem,
        "points": count,
        "pilot_points": choice.sizes["pilot_point"],
        "candidates": {str(label): int(number) for label, number in points if number},
        "recorded_share": choice.attrs.get("recorded_share"),
        **{
            each.name: told(errors(auto, full, chosen, each, study.auto_model.accuracy.floor), each.allowed)
            for each in study.auto_model.accuracy.quantities
        },
        "expected_not_met": int((choice["accuracy_met"] == 0).sum()),
        "counted_cpu_s": price,
        "times_cheaper": price["reference"] / (price["study"] + price["pilot"]),
        "times_cheaper_without_pilot": price["reference"] / everywhere,
    }


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("studies", nargs="*", default=NAMES)
    parser.add_argument("--checked", type=int, default=CHECKED, help="points that are compared")
    parser.add_argument("--workers", type=int, default=1, help="0: in this process")
    given = parser.parse_args(arguments)
    for name in given.studies:
        path = Path(name) if name.endswith(".toml") else STUDIES / f"{name}.toml"
        result = compare(path, given.out, given.checked, given.workers)
        print(json.dumps(result, indent=1), flush=True)
        (given.out / f"{path.stem}.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
