"""The ablation: switches of mechanisms off and on, in all combinations or one at a time.

A switch multiplies the coefficient of its mechanism: the value 0.5 halves its friction.
"""

import itertools

from tripod_doe.errors import InputError
from tripod_doe.study.designs.design_interface import Family, Made, Request, column_of

HALF = 0.5
"""The switch of a friction that is halved."""

_MOST_SWITCHES = 16  # whose combinations are all made


def _ablation(request: Request) -> Made:
    """All on first; then every combination, or with none on, with each off alone and with each on alone.

    Points with one friction halved come last.
    """
    design, switches = request.table, request.factors
    for name, factor in switches.items():
        if factor.table.model_fields_set and set(factor.values or ()) != {0, 1}:
            raise InputError(f"[factors.{name}]: an ablation switches between 0 and 1; give values = [0, 1]")
    count = len(switches)
    if design.combinations == "all":
        if count > _MOST_SWITCHES:
            raise InputError(
                f"all combinations of {count} switches are {2**count:,} points, more than {_MOST_SWITCHES} make; "
                'set combinations = "single" or name fewer factors'
            )
        rows: list[tuple[float, ...]] = list(itertools.product((1, 0), repeat=count))
    else:
        alone = [tuple(int(each == on) for each in range(count)) for on in range(count)]
        without = [tuple(1 - state for state in row) for row in alone]
        rows = list(dict.fromkeys([(1,) * count, (0,) * count, *without, *alone]))  # two switches: some are the same
    if design.halved:
        rows += [tuple(HALF if each == halved else 1 for each in range(count)) for halved in range(count)]
    return Made({name: column_of(f, (row[at] for row in rows)) for at, (name, f) in enumerate(switches.items())})


def _count(request: Request) -> int:
    switches = len(request.factors)
    return (2**switches if request.table.combinations == "all" else 2 * switches + 2) + switches * request.table.halved


ABLATION = {"ablation": Family(_ablation, _count)}
"""The ablation by its kind."""
