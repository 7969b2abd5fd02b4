"""Scatter of dimensions and frictions: one fixed sample of it for all candidates, another one to confirm them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.optimisation.optimisation_file import OptimisationRequest
from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Parameter, Value
from tripod_doe.study.definition.distributions import quantile, scatter_density
from tripod_doe.study.definition.factors import Factor, checked_factor
from tripod_doe.study.definition.study_file_schema import FactorTable

_ABOUT = ("normal", "truncated-normal")  # distributions with a mean


@dataclass(frozen=True)
class Scatter:
    """Parameters that scatter, with their distributions."""

    factors: Mapping[str, Factor]  # by name; of variables with an unlimited parameter
    relative: frozenset[str]  # names of variables, which scatter about the value of each candidate
    parameters: Mapping[str, Parameter]  # the parameters themselves

    def sample(self, count: int, seed: int) -> dict[str, NDArray[Any]]:
        """A sample, shape (joint,) each: values, or differences from the value of a candidate."""
        if not self.factors:
            return {}
        from scipy.stats import qmc

        power = max(int(np.ceil(np.log2(count))), 0)
        unit = qmc.Sobol(len(self.factors), rng=seed).random_base2(power)[:count]
        sample: dict[str, NDArray[Any]] = {}
        for at, (name, factor) in enumerate(self.factors.items()):
            values = quantile(factor, unit[:, at])
            if name in self.relative:
                values = values - _centre(factor.table)
            sample[name] = values
        return sample

    def misfit(self, name: str, values: Iterable[float]) -> str:
        """Why a parameter cannot have one of these values, which a candidate has with the scatter; else empty."""
        for value in values:
            try:
                self.parameters[name].check(value)
            except InputError as error:
                return f"[scatter.{name}] reaches {error}"
        return ""


def _centre(table: FactorTable) -> float:
    """The value of a distribution that a candidate takes: its mean, else its centre, or the mean of listed values."""
    if table.mean is not None:
        return table.mean
    density = scatter_density(table)
    if density is not None:
        return density.centre
    return float(np.average(np.array(table.values, float), weights=table.weights))


def make_scatter(
    request: OptimisationRequest, parameters: Mapping[str, Parameter], base: Mapping[str, Value]
) -> Scatter:
    """The scatter of a file.

    Without a mean, a normal distribution is about the value of the candidate, or about the base value. Any other one
    takes the place of a base value, so that the [base] of a fit needs no change.

    Raises:
        InputError: If a parameter is unknown, or a distribution wrong.
    """
    factors: dict[str, Factor] = {}
    relative = frozenset(request.file.scatter) & frozenset(request.file.variables)
    for name, table in request.file.scatter.items():
        where = f"[scatter.{name}]"
        if name not in parameters:
            raise request.fail(where, f"unknown parameter{near_match(name, parameters)}")
        parameter, about_base = parameters[name], table.sampled_as in _ABOUT and table.mean is None
        if parameter.kind not in ("number", "argument"):
            raise request.fail(where, f"only a number scatters, and {name} is {parameter.range_text}")
        if about_base:
            usual = 0.0 if name in relative else base.get(name, parameter.default)
            if not isinstance(usual, int | float):
                raise request.fail(where, f"give a mean: {name} has no base value")
            table = table.model_copy(update={"mean": float(usual)})
            if name in relative and table.low is not None and table.high is not None and table.low > 0:
                raise request.fail(where, "give a mean, or low and high as differences from the value of a candidate")
        if name in relative and table.sampled_as == "log-uniform":
            raise request.fail(where, "log-uniform does not scatter about a candidate: take uniform or triangular")
        own = replace(parameter, low=-np.inf, high=np.inf, low_open=False) if name in relative else parameter
        try:
            factor = checked_factor(own, table)
            quantile(factor, np.array([0.5]))
        except InputError as error:
            raise request.fail(where, error) from error
        factors[name] = factor
    return Scatter(factors, relative, parameters)
