"""Points of a result directory, to be simulated again and shown in motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, option
from tripod_doe.study.query.query import records
from tripod_doe.study.result_directory.open_cube import opened_cube
from tripod_doe.study.result_directory.stored_study import stored_study


def points_in(directory: Path, select: Sequence[str] = (), nearest: bool = False) -> list[dict[str, Any]]:
    """Parameters, as `simulate` takes them, of the one or two points of a result directory that match a selection.

    Args:
        select: ``name=value`` for factors.
        nearest: Take the nearest value if none matches.

    Raises:
        InputError: If the study has another scene, or the selection matches no point or more than two.
    """
    study = stored_study(directory)
    if study.simulator.name != "joint":
        raise InputError(f"{directory}: only the scene joint can be viewed, not {study.simulator.name}")
    with opened_cube(directory) as cube:
        columns = records(cube, "outcome", select, nearest)
        of_point = {name: column for name, column in columns.items() if name in study.simulator.parameters}
        if study.auto_model:
            of_point |= {
                name: records(cube, name, select, nearest)[name]
                for name in study.auto_model.parameters
                if name in cube.variables
            }
    count = columns["outcome"].size
    if not 1 <= count <= 2:
        several = [f"{name}={next(iter(column.tolist()), '')}" for name, column in of_point.items()]
        advice = " ".join(option("select", text) for text in several)
        raise InputError(f"{directory}: the selection leaves {count} points; choose one or two, for instance {advice}")
    each = [{name: column.tolist()[i] for name, column in of_point.items()} for i in range(count)]
    return [
        {name: value for name, value in {**study.base, **own}.items() if value is not None and value == value}
        for own in each
    ]
