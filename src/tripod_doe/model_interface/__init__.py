"""The interface between studies and models: parameters, outputs, outcomes, blocks of results, and the simulator.

No model and no study is in here.
"""

from tripod_doe.model_interface.block import (
    WORK,
    BlockResult,
    Retries,
    Values,
    common_unit,
    refuse_other_dims,
    take_labels,
)
from tripod_doe.model_interface.candidate import Candidate
from tripod_doe.model_interface.counted_time import counted_time, not_counted
from tripod_doe.model_interface.known_error import NOTABLE_ERROR, Departure, ModelErrors, ValidRange
from tripod_doe.model_interface.model_summary import ModelSummary
from tripod_doe.model_interface.outcome import (
    DETAIL_ATTRIBUTES,
    OUTCOME_ATTRIBUTES,
    OUTCOME_MEANINGS,
    Flag,
    Outcome,
    cf_flags,
)
from tripod_doe.model_interface.output import MIRRORED_BY, ZERO_AT, Dimension, Output
from tripod_doe.model_interface.parameter import Parameter, Value, check_parameters, is_set, read_parameters
from tripod_doe.model_interface.required_accuracy import Accuracy, Quantity
from tripod_doe.model_interface.simulator import NOT_REPRESENTED, NUMERICS, Methods, Simulator, by_name, model_notes
from tripod_doe.model_interface.verdict import TRUST_ATTRIBUTES, Trust

__all__ = [
    "DETAIL_ATTRIBUTES",
    "MIRRORED_BY",
    "NOTABLE_ERROR",
    "NOT_REPRESENTED",
    "NUMERICS",
    "OUTCOME_ATTRIBUTES",
    "OUTCOME_MEANINGS",
    "TRUST_ATTRIBUTES",
    "WORK",
    "ZERO_AT",
    "Accuracy",
    "BlockResult",
    "Candidate",
    "Departure",
    "Dimension",
    "Flag",
    "Methods",
    "ModelErrors",
    "ModelSummary",
    "Outcome",
    "Output",
    "Parameter",
    "Quantity",
    "Retries",
    "Simulator",
    "Trust",
    "ValidRange",
    "Value",
    "Values",
    "by_name",
    "cf_flags",
    "check_parameters",
    "common_unit",
    "counted_time",
    "is_set",
    "model_notes",
    "not_counted",
    "read_parameters",
    "refuse_other_dims",
    "take_labels",
]
