"""The choice of model of a study with model = "auto": pilot, its errors, selection, stored in the result directory.

No point runs twice, neither in the pilot as it grows (`growing_pilot`) nor in the study (`pilot_results`).
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from tripod_doe.analyses.model_choice.choice_by_record import RecordedChoice, choice_by_record
from tripod_doe.analyses.model_choice.growing_pilot import GrowingPilot, confirming_sizes, first_candidates
from tripod_doe.analyses.model_choice.pilot import (
    finished_in_pilot,
    least_points,
    pilot_points,
    pilot_study,
    usable_points,
)
from tripod_doe.analyses.model_choice.selection import choose, full_candidates, without_pilot
from tripod_doe.errors import InputError
from tripod_doe.files.checksum_list import number_in
from tripod_doe.model_interface import Candidate
from tripod_doe.number_text import duration, number
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points, make_points
from tripod_doe.study.execution.timing import time_points
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import PILOT, journal_path
from tripod_doe.study.plan import RECORDED
from tripod_doe.study.result_directory.stored_choice import (
    CHOICE,
    auto_model_of,
    chosen_points,
    frozen_choice,
    key_texts,
)

_TIMING_SECONDS = 20.0  # for each candidate; a run of the full model takes a few seconds


def make_choice(
    study: Study, points: Points, directory: Path, run_pilot: Callable[[Study, Path], object]
) -> xr.Dataset:
    """The choice for all points of a study: the stored choice, if any, else the choice of a pilot that runs now.

    Args:
        directory: Its result directory: the pilot lies in pilot/, the choice in choice.nc.
        run_pilot: Runs what is missing of a pilot in a directory.

    Raises:
        InputError: If the choice costs more than the budget, or is frozen for another accuracy.
    """
    auto = auto_model_of(study)
    usable = {name: column[points.allowed] for name, column in points.columns.items()}
    keys = key_texts(study, points)[points.allowed]
    frozen = frozen_choice(study, directory)
    if frozen is not None and set(keys) <= set(frozen["point_key"].values.tolist()):
        return frozen
    pilot = GrowingPilot(study, points, usable, directory / PILOT, run_pilot)
    choice: xr.Dataset | None = None
    if frozen is None:
        record = choice_by_record(study, points)
        _check_budget(study, _pilot_price(*_first_stage(study, points, record)), "the pilot alone")
        choice = pilot.choose(record)
    elif (directory / PILOT / "cube.nc").exists():  # the study grew
        record = choice_by_record(study, points) if "recorded_share" in frozen.attrs else None
        measured = pilot.errors_so_far()
        choice = pilot.confirmed(record, measured) if record else None
        choice = choose(measured, usable, auto) if choice is None else choice
    if choice is None:
        choice = without_pilot(usable, auto)
    choice = choice.assign_coords(point_key=("point", keys, {"long_name": "fingerprint of the point"}))
    if frozen is not None:
        choice = _with_frozen(choice, frozen)
    choice = _without_pilot_points(study, points, choice, directory / PILOT)
    price = choice.attrs["price_pilot_s"] + choice.attrs["price_study_s"]
    _check_budget(study, price, "pilot and study")
    attrs = {
        "Conventions": "CF-1.8",
        "title": f"{study.file.study.name}: choice of model",
        "institution": "tripod_doe",
        "source": f"pilot with simulator {study.simulator.name}",
        "references": "Angelopoulos et al., Conformal risk control, ICLR 2024",
    }
    choice = stamp_history(
        choice.assign_attrs(attrs), "tripod-doe run: model chosen", number_in(journal_path(directory))
    )
    write_dataset(choice, directory / CHOICE)
    return choice


def _with_frozen(choice: xr.Dataset, frozen: xr.Dataset) -> xr.Dataset:
    """A choice in which the points that were chosen for before keep what they had."""
    known = {key: row for row, key in enumerate(frozen["point_key"].values.tolist())}
    rows = [known.get(key, -1) for key in choice["point_key"].values.tolist()]
    new, old = np.flatnonzero(np.array(rows) < 0), [row for row in rows if row >= 0]
    along = [name for name in choice.variables if "point" in choice[name].dims]
    joined = xr.concat([frozen[along].isel(point=old), choice[along].isel(point=new)], "point", join="override")
    rest = choice.drop_dims("point")
    return xr.merge([rest, joined], combine_attrs="override").assign_attrs(choice.attrs)


def _without_pilot_points(study: Study, points: Points, choice: xr.Dataset, pilot: Path) -> xr.Dataset:
    """The choice with the price of the points that its pilot did not run."""
    chosen = chosen_points(study, points, choice)
    ran = np.isin(point_keys(study, chosen)[points.allowed], finished_in_pilot(pilot))
    price = float(choice["price"].values[choice["candidate"].values][~ran].sum())
    return choice.assign_attrs({"price_study_s": price, "points_from_pilot": int(ran.sum())})


def _first_stage(study: Study, points: Points, record: RecordedChoice | None) -> tuple[list[Candidate], int]:
    """Candidates that a pilot starts with, and at how many points; by the record, those that confirm it at best."""
    if record and (sizes := confirming_sizes(study, points, record)):
        return [*record.chosen, first_candidates(auto_model_of(study))[-1]], sizes[1]
    return first_candidates(auto_model_of(study)), pilot_points(study, points).size


def _pilot_price(candidates: list[Candidate], count: int) -> float:
    """CPU seconds of the first stage of a pilot, from recorded work."""
    return count * sum(candidate.price for candidate in candidates)


def _check_budget(study: Study, price: float, what: str) -> None:
    budget = auto_model_of(study).budget_cpu_s
    if budget is not None and price > budget:
        raise InputError(
            f"{study.origin}: [accuracy]: budget_cpu_s = {budget:g}: {what} would take about "
            f"{duration(price)} of CPU time; raise it, allow a larger error, or take fewer points"
        )


def describe_choice(study: Study, directory: Path | None, timing: bool = False) -> str:
    """The choice in lines of text, for `plan`; before it is made, the price of the pilot.

    Args:
        directory: Its result directory, if there may be a choice already.
        timing: Whether to time each candidate at points of the pilot, in processes of their own; else prices on record
            stand in, of usual points of another machine, and a pilot goes to the edges of a design.
    """
    points = make_points(study)
    choice = frozen_choice(study, directory) if directory else None
    if choice is not None:
        return "\n".join(_summary(choice))
    record = choice_by_record(study, points)
    candidates, count = _first_stage(study, points, record)
    if not count:
        full, count = full_candidates(auto_model_of(study))[0], int(points.allowed.sum())
        usable, least = usable_points(study, points)[1].size, least_points(study, points)
        without = " (without repeated ones and those with a friction halved)" * (usable < count)
        return (
            f"choice       too few points for a pilot, {usable} of at least {least}{without}: "
            f"{full.label} everywhere, CPU time about {duration(count * full.price)}"
        )
    priced = [_timed(study, points, each, count) if timing else (each, RECORDED) for each in candidates]
    candidates = [each for each, _ in priced]
    usual = candidates[-1]
    return "\n".join(
        [
            _pilot_summary(study, points, record, candidates, count),
            f"study        CPU time about {duration(points.count * usual.price)} if all points run with {usual.label}",
            *(
                f"candidate    {each.label}: CPU time {duration(each.price, 2)} per run, {source}"
                for each, source in priced
            ),
        ]
    )


def _pilot_summary(
    study: Study, points: Points, record: RecordedChoice | None, first: list[Candidate], count: int
) -> str:
    """Price of a pilot in a line: of its `first` stage, and what it is at most where it must grow.

    Candidates that were not timed cost what the record says of them in relation to the last one of the first stage.
    """
    usual, every = first[-1], auto_model_of(study).candidates
    at = next(number for number, each in enumerate(every) if each.values == usual.values)
    prices = [usual.price * each.price / every[at].price for each in every]
    sizes = confirming_sizes(study, points, record)
    begins, finer = _pilot_price(first, count), count * sum(prices[at + 1 :])
    largest = max([count, pilot_points(study, points).size, *sizes])
    line = f"pilot        {count} points on {len(first)} candidates, CPU time about {duration(begins)}"
    if finer:
        line += f", {duration(begins + finer)} if each point needs finer runs of the full model"
    if (most := largest * sum(prices)) > begins + finer:
        line += f", at most about {duration(most)} if it must grow to {largest} points on all candidates"
    return line + ("; it is to confirm errors that are on record for similar points" if sizes else "")


def _timed(study: Study, points: Points, candidate: Candidate, count: int) -> tuple[Candidate, str]:
    """A candidate with its mean price at points of the pilot, and where the price is from."""
    places = pilot_points(study, points, count)
    seconds = time_points(pilot_study(study, points, [(candidate, places)]), _TIMING_SECONDS)
    price = float(np.mean(seconds)) if seconds else max(_TIMING_SECONDS, candidate.price)
    source = "timed at points of the pilot" if seconds else f"a guess: none ended within {duration(_TIMING_SECONDS)}"
    return replace(candidate, evaluations=price / candidate.evaluation_seconds), source


def _summary(choice: xr.Dataset) -> list[str]:
    """A choice in lines: what it takes, what each candidate missed in the pilot, and what it costs."""
    attrs, pilot = choice.attrs, choice.sizes["pilot_point"]
    if not pilot:
        full, count = choice["candidate_label"].values[0], choice.sizes["point"]
        price = duration(attrs["price_study_s"])
        return [f"choice       too few points for a pilot: {full} at all {count:,} points, CPU time about {price}"]
    lines = [
        f"choice       by recorded errors of similar points, confirmed by {pilot} pilot points: "
        f"{number(100 * attrs['recorded_share'], digits=2)} % of the points are expected to meet the accuracy"
        if "recorded_share" in attrs
        else f"choice       from {pilot} pilot points; predicted errors up to {attrs['limit']:.0%} of the allowed one "
        f"are accepted; in cross-validation {attrs['misses']} of these points miss the accuracy"
    ]
    for at, label in enumerate(choice["candidate_label"].values):
        row = choice.isel(candidate_number=at)
        measured = row["pilot_error"].max("pilot_point")
        errors = ", ".join(
            f"{name} {number(float(e), 2)}" for name, e in zip(choice["quantity"].values, measured.values, strict=True)
        )
        lines.append(
            f"candidate    {label}: {int(row['points_of_candidate']):,} points, CPU time "
            f"{duration(float(row['price']), 2)} per run; largest errors: {errors}"
        )
    if unknown := attrs.get("pilot_unknown", 0):
        lines.append(
            f"pilot        at {unknown} of its {pilot} points the error of the full model alone exceeds the accuracy"
        )
    unmet = int((choice["accuracy_met"] == 0).sum())
    chosen, of_pilot, finest = (duration(attrs[f"price_{which}_s"]) for which in ("study", "pilot", "reference"))
    lines.append(
        f"price        CPU time {chosen}, and {of_pilot} for the pilot, which ran {attrs['points_from_pilot']} of the "
        f"points; {finest} if all points ran with the last candidate"
    )
    if unmet:
        why = "by the errors on record" if "recorded_share" in attrs else "not even with the finest candidate"
        lines.append(f"warning      {unmet:,} points are not expected to meet the accuracy with its confidence, {why}")
    return lines
