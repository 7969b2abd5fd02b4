"""Description of a model: numerics, outputs, missing effects, valid ranges, and its function to simulate a block."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS
from tripod_doe.model_interface import BlockResult, Methods, ValidRange

RATES = tuple(output.name for output in RATE_OUTPUTS)
SKEWS = ("needle_skew_deg", "needle_skew_summary_deg")


@dataclass(frozen=True)
class Model:
    """One model of the ladder."""

    name: str  # the value of the parameter ``model``
    # solution methods, the default first, with the numerics parameters that each uses and their defaults
    methods: Methods
    outputs: frozenset[str]  # names of the outputs that it computes
    # (block of points, method, samples per revolution, outputs to keep, required accuracy per order or None for the
    # third order's `accuracy`) -> results
    simulate: Callable[[JointValues[FloatArray], str, int, Collection[str], OrderAccuracy | None], BlockResult]
    # (block of one point, method): compiles all that `simulate` needs
    prepare: Callable[[JointValues[FloatArray], str], None]
    ignores: frozenset[str] = frozenset()  # parameters that it cannot represent
    # whether a run finds its tolerance or step if none is given; if not, the method's default satisfies every possible
    # required accuracy
    settles: bool = False
    # parameters whose effect this model lacks in whole or in part, each with a sentence on what is missing
    lacks: Mapping[str, str] = field(default_factory=dict)
    valid: tuple[ValidRange, ...] = ()  # valid ranges

    @property
    def default_method(self) -> str:
        """The method to use if none is named."""
        return next(iter(self.methods))
