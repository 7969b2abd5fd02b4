"""The table [accuracy] of a study: quantities, their allowed relative errors, and the confidence with model = "auto".

If the study names a model, runs are refined until their numerical errors are below these values. With model = "auto" a
pilot chooses the model of every point by its total error.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import NUMERICS, Accuracy, Candidate, Quantity, Simulator

AUTO = "auto"
"""Value of `model` by which a pilot chooses the model of every point."""


@dataclass(frozen=True)
class AutoModel:
    """The checked table [accuracy] of a study with model = "auto"."""

    accuracy: Accuracy  # the quantities with their allowed errors
    confidence: float  # share of the points that must meet them
    budget_cpu_s: float | None  # largest estimated cost of pilot and study; None: no limit
    candidates: tuple[Candidate, ...]  # the models to choose from, from the cheapest to the finest

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that are chosen."""
        return tuple(self.candidates[0].values)

    @property
    def least_points(self) -> int:
        """Smallest number of pilot points that can show the confidence: among fewer, one miss exceeds it."""
        return round(1 / (1 - self.confidence)) - 1


def check_auto_model(
    simulator: Simulator,
    accuracy: Mapping[str, float],
    confidence: float,
    floor: float,
    budget: float | None,
    taken: Collection[str],
) -> AutoModel:
    """Check the accuracy that an automatic choice of the model must meet.

    Args:
        confidence, budget: See `AutoModel`.
        floor: See `Accuracy`.
        taken: Parameters that the study sets; the choice does not change them.

    Raises:
        InputError: If the simulator has one model only, nothing is asked for, or a quantity is unknown or has no size.
    """
    if any(name in taken for name in NUMERICS):
        taken = {*taken, "accuracy"}  # which has no effect if a tolerance or step is given
    candidates = own_candidates(simulator.candidates, taken)
    if len(candidates) < 2:
        fixed = ", ".join(sorted(set(taken) & {n for candidate in simulator.candidates for n in candidate.values}))
        why = f"the study sets {fixed} itself, so there is nothing to choose" if fixed else "it has one model"
        raise InputError(f'[base]: model = "{AUTO}": {simulator.name}: {why}; name the model')
    return AutoModel(check_accuracy(simulator, accuracy, floor), confidence, budget, candidates)


def check_accuracy(simulator: Simulator, accuracy: Mapping[str, float], floor: float) -> Accuracy:
    """Check quantities and their allowed errors.

    Raises:
        InputError: If nothing is asked for, or a quantity is unknown or has no numerical error.
    """
    if not accuracy:
        raise InputError("[accuracy]: name what must be accurate, for instance thrust_amplitude_3 = 0.03")
    return Accuracy(tuple(_quantity(simulator, name, allowed) for name, allowed in accuracy.items()), floor)


def own_candidates(known: Sequence[Candidate], taken: Collection[str]) -> tuple[Candidate, ...]:
    """The candidates of a study, reduced to the parameters that differ and that the study does not set itself.

    Substitutes that change a parameter of the study are left out; of equal candidates the full one is kept.
    """
    full = next((candidate for candidate in known if candidate.full), known[-1]) if known else None
    kept: dict[str, Candidate] = {}
    for candidate in known:
        own = {name: value for name, value in candidate.values.items() if name not in taken}
        if (
            full
            and candidate.substitute
            and any(full.values[name] != candidate.values[name] for name in candidate.values.keys() - own)
        ):
            continue
        bare = replace(candidate, values=own)
        if bare.label not in kept or (bare.full and not kept[bare.label].full):
            kept[bare.label] = bare
    differ = {name for candidate in kept.values() for name in candidate.values if _varies(name, kept.values())}
    return tuple(
        replace(candidate, values={name: value for name, value in candidate.values.items() if name in differ})
        for candidate in kept.values()
    )


def _varies(name: str, candidates: Collection[Candidate]) -> bool:
    return len({candidate.values[name] for candidate in candidates}) > 1


def _quantity(simulator: Simulator, name: str, allowed: float) -> Quantity:
    if not 0 < allowed < 1:
        raise InputError(f"[accuracy]: {name} = {allowed:g}: a relative error lies between 0 and 1")
    output, _, label = name.rpartition("_")
    if not simulator.outputs:  # a function's outputs are known from its first answer
        return Quantity(name, output, int(label), allowed) if label.isdigit() else Quantity(name, name, None, allowed)
    known = [key for key in simulator.outputs if Quantity(key, key, None, allowed).error in simulator.outputs]
    if label.isdigit() and output in known and len(simulator.outputs[output].dims) == 1:
        return Quantity(name, output, int(label), allowed)
    examples = [f"{key}_{order}" for key in known for order in range(13)]
    raise InputError(
        f"[accuracy]: {name}: not a quantity with a known numerical error{near_match(name, examples)}"
        if near_match(name, examples)
        else f"[accuracy]: {name}: not a quantity with a known numerical error; write OUTPUT_ORDER with an output of "
        f"{', '.join(known)}"
    )
