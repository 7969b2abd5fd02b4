"""The split of a study, as its result directory holds it: written into `study.toml`, which is then a static study."""

from pathlib import Path
from typing import Any

import tomlkit
import xarray as xr

from tripod_doe.analyses.multifidelity.split import Split, find_split
from tripod_doe.errors import CubeError, InputError
from tripod_doe.model_interface import Value
from tripod_doe.number_text import duration, number
from tripod_doe.study.definition.study import Study, canonical
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_file_schema import DesignTable
from tripod_doe.study.designs import SAMPLE, make_points, most_points, pilot_samples, point_count
from tripod_doe.study.plan import RECORDED, plan_points
from tripod_doe.study.result_directory.open_cube import opened_cube
from tripod_doe.study.result_directory.stored_study import STORED, stored_study


def needs_split(study: Study) -> bool:
    """Whether a pilot decides how many samples each model of a study gets."""
    return study.file.design.kind == "multifidelity" and not study.file.design.split


def stored_split(study: Study, directory: Path) -> Study | None:
    """The same study with the split stored in a directory; None if there is none, or it is for another study."""
    stored = _study_with_split(study, directory)
    if stored is None or _tables_without_split(stored) != _tables_without_split(study):
        return None
    return _with_split(study, stored.file.design)


def _study_with_split(study: Study, directory: Path) -> Study | None:
    if not (directory / STORED).exists():
        return None
    try:
        stored = stored_study(directory)
    except CubeError:  # damaged: the points of its pilot show the split again
        return None
    return stored if stored.file.design.split else None


def _tables_without_split(study: Study) -> dict[str, str]:
    """The parts of a study that decide its points, without its split."""
    of_split = ("design.split", "design.prices")
    return {key: value for key, value in canonical(study).items() if not key.startswith(of_split)}


def with_samples_so_far(study: Study, directory: Path) -> Study:
    """A study that needs a split, with the samples stored in a directory; unchanged if none are stored."""
    old = _study_with_split(study, directory)
    if old is None:
        return study
    table = study.file.design
    pilot, last = pilot_samples(table), str((study.factors[table.fidelity].values or ())[-1])
    split = {model: max(count, pilot) for model, count in old.file.design.split.items()} | {last: table.samples or 0}
    return _with_split(study, table.model_copy(update={"split": split, "prices": old.file.design.prices}))


def split_study(study: Study, pilot: xr.Dataset, directory: Path) -> tuple[Study, Split]:
    """The study with the split that its pilot shows; a study that grew keeps the samples that it had.

    Raises:
        InputError: If the pilot does not suffice.
    """
    try:
        split = find_split(pilot, study.simulator)
    except InputError as error:
        raise study.fail("the pilot", error) from error
    old = _study_with_split(study, directory)
    before = old.file.design.split if old else {}
    truth = next(iter(split.samples))
    samples = {model: max(count, before.get(model, 0)) for model, count in split.samples.items()}
    samples[truth] = split.samples[truth]
    table = DesignTable(kind="multifidelity", split=samples, prices=dict(split.prices))
    return _with_split(study, table), split


def _with_split(study: Study, table: DesignTable) -> Study:
    """A study with the split and prices of another table."""
    document: Any = tomlkit.parse(study.text)
    for key, value in (("split", table.split), ("prices", table.prices)):
        inline = tomlkit.inline_table()
        inline.update(value)
        document["design"][key] = inline
    return parse_study(tomlkit.dumps(document), study.origin, study.folder)


def split_lines(split: Split) -> list[str]:
    """A split in lines of text."""
    truth = next(iter(split.samples))
    of = f" of {split.block} points" if split.block > 1 else ""
    lines = [f"split        from a pilot of {split.pilot} samples{of} in every model"]
    for model, count in split.samples.items():
        text = (
            "the truth" if model == truth else f"explains {number(100 * split.explained[model], 3)} % of its variance"
        )
        if model != truth and count <= split.samples[truth]:
            text += ", not worth its price"
        price = duration(split.prices[model], 2)
        lines.append(f"model        {model}: {count:,} samples, CPU time {price} per point; {text}")
    lines.append(
        f"price        CPU time {duration(split.seconds)}; expected variance {number(1 / split.gain, 2)} times that "
        f"with {truth} alone at this price"
    )
    return lines


def describe_split(study: Study, directory: Path | None, timing: bool = False) -> list[str]:
    """The split of a multifidelity study in lines, for `plan`: from a directory, else what decides it.

    Args:
        timing: Whether to time points for the largest price; else prices on record are used.
    """
    if not needs_split(study):
        return []
    if directory is not None and (directory / "cube.nc").exists():
        return split_lines(_split_of_results(study, directory))
    table = study.file.design
    truth, most = (study.factors[table.fidelity].values or ())[-1], most_points(study)
    lines = [
        f"split        decided by a pilot of {point_count(study):,} points; {truth} runs {table.samples:,} samples, "
        f"all models together at most {most:,} points (most_points)"
    ]
    largest = _largest_split(study)
    price = plan_points(largest, make_points(largest), timing, recorded=True, judged=False)
    if price.cpu_hours:
        source = f"from {price.timed} timed points" if price.timed else RECORDED
        lines.append(f"in all       CPU time at most about {duration(3600 * price.cpu_hours[1])} ({source})")
    return lines


def _largest_split(study: Study) -> Study:
    """The study with all samples that a split may have, those besides the truth's by the most expensive other model."""
    table, models = study.file.design, list(study.factors[study.file.design.fidelity].values or ())
    pilot, samples = pilot_samples(table), table.samples or 0
    whole = most_points(study) * pilot * len(models) // point_count(study)  # samples of all models together

    def price(model: Value) -> float:
        return study.simulator.recorded_price({**study.base, table.fidelity: model}) or 0.0

    *others, truth = models
    most_expensive = max(reversed(others), key=price)
    split = dict.fromkeys(map(str, others), pilot) | {str(truth): samples}
    split[str(most_expensive)] += whole - sum(split.values())
    return _with_split(study, table.model_copy(update={"split": split}))


def _split_of_results(study: Study, directory: Path) -> Split:
    with opened_cube(directory) as cube:
        pilot = cube[SAMPLE].values < pilot_samples(study.file.design)
        return find_split(cube.isel(point=pilot), study.simulator)
