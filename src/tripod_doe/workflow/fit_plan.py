"""Price of a fit before anything runs, from the number of its points and the time of a few points."""

from dataclasses import dataclass
from pathlib import Path

from tripod_doe.analyses.fit.estimation.exploration import place_count
from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.number_text import count_of, duration, text_range
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.toml_text import toml_text
from tripod_doe.study.plan import RECORDED, Plan, plan

_DESCENT = 2  # evaluations of all records for a start, its descents after both looks together, per squared unknown
# evaluations of all records for the profile of a scalar: with one unknown, and for each further one
_PROFILE, _PER_OTHER = 2, 6
_AGAIN = 45  # at most besides these: a profile came upon a better minimum, or went along a valley
# what a fit takes of these, at least and usually: with a known angle of the marker, and where skews may change places
_LEAST_USUAL, _LEAST_USUAL_IN_A_CIRCLE = (0.4, 0.8), (0.7, 2.0)
_IN_A_CIRCLE = 3  # places from which a search begins
_MOST, _MOST_OF_BOTH = 1.5, 2.0  # at most, with one kind of needles and with both
_FEWEST_DESCENTS = 2  # of one start, with the first weights and with the next
_CORRECTIONS = 3  # usual evaluations with the requested model
# CPU time besides the points (benchmarks/RESULTS.md): imports, records and page; both looks at the interpolated model,
# per unknown; an evaluation
_START_SECONDS, _LOOK_SECONDS, _OWN_SECONDS = 6.0, 0.55, 3e-3


@dataclass(frozen=True)
class FitPlan:
    """Counts and prices of a fit."""

    records: int  # number of records
    scalars: tuple[str, ...]  # fitted scalars, each with its record or group
    search_points: int  # usual number of points of the model of the search
    search_range: tuple[int, int]  # its range
    asked_points: int  # usual number of points with the requested model, if it differs
    models: tuple[str, str]  # the requested model, and the model of the search
    plans: tuple[Plan, ...]  # plans of the points of all records, with the model of the search and the requested one
    seconds: tuple[float, float, float] | None  # CPU seconds: lower quartile, mean, upper quartile; None if not known

    def describe(self, workers: int = 2) -> str:
        """The plan as text, with the wall time on a number of workers."""
        least, most = map("{:,}".format, self.search_range)
        lines = [
            f"records      {self.records}",
            f"unknowns     {count_of(len(self.scalars), 'number')}: {', '.join(self.scalars)}",
            f"points       about {self.search_points:,} with {self.models[1]} ({least} to {most}, "
            "several times more where records say little)",
        ]
        if self.asked_points:
            lines[-1] += f", about {self.asked_points:,} with {self.models[0]}"
        if self.seconds is None:
            lines.append("price        not known: nothing was timed")
        else:
            low, mean, high = map(duration, self.seconds)
            timed = sum(each.timed for each in self.plans)
            source = f"from {timed} timed points" if timed else RECORDED
            lines.append(f"CPU time     {mean} ({text_range(low, high)}, {source})")
            lines.append(f"wall time    {duration(self.seconds[1] / max(workers, 1))} on {workers} workers, or more")
        lines += [f"model        {text.removeprefix('Model ')}" for each in self.plans for text in each.models]
        return "\n".join(lines + [f"warning      {text}" for each in self.plans for text in each.warnings])


def plan_fit(file: str | Path, timing: bool = True, untrusted: bool = False) -> FitPlan:
    """Read all records of a fit, and count and time its points; nothing is written.

    Args:
        file: The fit file.
        timing: Whether points are timed, for at most ten seconds a model.
        untrusted: For a file from a stranger: refuse files outside of its folder.

    Raises:
        InputError: If the file or a record cannot be used.
    """
    rig = FitProblem(load_fit(file, untrusted))
    records, width = len(rig.records), len(rig.layout.unknowns)
    trials = evaluations(rig)
    models = list(dict.fromkeys([rig.cheap, rig.model]))
    search = [round(count * _distinct(rig, rig.cheap) + (width + 1) * len(rig.candidates)) for count in trials]
    asked = _CORRECTIONS * _distinct(rig, rig.model) if len(models) > 1 else 0
    plans = [plan(_one_of_each(rig, model), timing, recorded=True) for model in models]
    seconds = None
    if all(each.cpu_hours for each in plans):
        parts = [
            [3600 * count * hours / each.unique for count, hours in zip(counts, each.cpu_hours, strict=True)]
            for each, counts in zip(plans, (search, [asked] * 3), strict=False)
            if each.cpu_hours
        ]
        beside = [_START_SECONDS + _LOOK_SECONDS * width + _OWN_SECONDS * count for count in trials]
        low, mean, high = (sum(part) for part in zip(*parts, beside, strict=True))
        seconds = low, mean, high
    least, usual, most = search
    names, pair = tuple(rig.layout.names()), (rig.model, rig.cheap)
    return FitPlan(records, names, usual, (least, most), asked, pair, tuple(plans), seconds)


def evaluations(rig: FitProblem) -> tuple[float, float, float]:
    """Evaluations of all records that a fit takes: at least, usually, and at most but for rare ones.

    Where the records do not say which trunnion is the first, the search begins at three places, and profiles go over
    what they lead to. Where needles may keep their skew, both kinds may be fitted.
    """
    width = len(rig.layout.unknowns)
    profiles = rig.layout.count * (_PROFILE + _PER_OTHER * (width - 1))
    descents = max(rig.file.fit.starts, _FEWEST_DESCENTS) * _DESCENT * width**2
    first, each = place_count(rig.layout), descents + profiles
    circle, most = rig.skews_change_places, _MOST_OF_BOTH if rig.skews_may_stay else _MOST
    least, usual = _LEAST_USUAL_IN_A_CIRCLE if circle else _LEAST_USUAL
    most *= _IN_A_CIRCLE if circle else 1
    return first + least * each, first + usual * each, first + most * each + _AGAIN


def _distinct(rig: FitProblem, model: str) -> int:
    """Number of different records in the search; a record with unknowns of its own counts as different."""
    columns = [column.tolist() for column in rig.columns_at_middle(model).values()]
    return len(set(zip(*columns, *rig.layout.index.tolist(), strict=True)))


def _one_of_each(rig: FitProblem, model: str) -> Study:
    """A study of the points of all records, with the unknowns in the middle of their ranges."""
    content = {
        "study": {"name": "points of the records"},
        "base": rig.base,
        "factors": {name: {"values": column} for name, column in rig.columns_at_middle(model).items()},
        "design": {"kind": "zip"},
    }
    return parse_study(toml_text(content), rig.request.origin, rig.request.folder)
