"""Design tables of a study, checked: sub-designs of a product, keys of a kind, switches of an ablation, models."""

from __future__ import annotations

import json
from collections.abc import Mapping

from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Parameter, Simulator
from tripod_doe.study.definition.study_file_schema import DESIGN_KEYS, DesignTable, FactorTable, StudyFile, keys_read_by


def designs_of(file: StudyFile) -> list[DesignTable]:
    """The existing sub-designs of a product; of any other study its only design."""
    if file.design.kind != "product":
        return [file.design]
    return [file.designs[name] for name in file.design.of]


def check_parts(file: StudyFile) -> None:
    """Refuse a product whose sub-designs are not named, before an analysis misses one of them."""
    names, known = file.design.of, list(file.designs)
    if file.design.kind != "product":
        return
    if len(names) < 2:
        example, tables = (json.dumps(known), "") if len(known) > 1 else ("[...]", ", each with a table [design.NAME]")
        raise InputError(f"a product needs of = {example}, the names of two or more sub-designs{tables}")
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"of: no sub-design [design.{unknown[0]}]{near_match(unknown[0], known)}")


def refuse_unread_keys(design: DesignTable) -> None:
    """Refuse keys that this kind of design does not read."""
    if unread := sorted(design.model_fields_set - keys_read_by(design.kind)):
        kinds = ", ".join(kind for kind, keys in DESIGN_KEYS.items() if unread[0] in keys) or "sub-designs"
        raise InputError(
            f'{", ".join(unread)}: not used by kind = "{design.kind}"; leave it out ({unread[0]}: {kinds})'
        )


def varied_around_base(file: StudyFile) -> set[str]:
    """Factors that one-at-a-time designs vary: their values in [base] are the base point."""
    around = [part for part in designs_of(file) if part.kind == "one-at-a-time"]
    return {name for part in around for name in part.factors or file.factors}


def ablation_at_operating_points(simulator: Simulator, file: StudyFile) -> StudyFile:
    """Turn an ablation with other factors into a product: the ablation at each of their grid points."""
    if file.design.kind != "ablation":
        return file
    switches = _switches_of(file.design, simulator.parameters, list(file.factors))
    operating = [name for name in file.factors if name not in switches]
    if not operating:
        return file
    mechanisms = file.design.model_copy(update={"factors": switches, "constraints": []})
    parts = {"operating": DesignTable(factors=operating), "mechanisms": mechanisms}
    product = file.design.model_copy(update={"kind": "product", "of": list(parts), "factors": None})
    return file.model_copy(update={"design": product, "designs": parts})


def switches_of_study(simulator: Simulator, file: StudyFile) -> tuple[str, ...]:
    """Switches of the ablations of a study: as named, else the factors of the study, else all of the scene."""
    alone = file.design.kind != "product"
    switches: list[str] = []
    for part in designs_of(file):
        if part.kind == "ablation":
            switches += _switches_of(part, simulator.parameters, list(file.factors) if alone else [])
    return tuple(dict.fromkeys(switches))


def _switches_of(part: DesignTable, parameters: Mapping[str, Parameter], own: list[str]) -> list[str]:
    known = [name for name, each in parameters.items() if each.kind == "switch" and each.default == 1]  # what is on
    names = part.factors or ([name for name in own if name in known] if known else own) or known
    if not names:
        raise InputError(
            "an ablation needs factors = [...]: its arguments with values 0 and 1, since no parameter is a switch"
        )
    for name in names:
        if name not in parameters:
            raise InputError(f"factors: unknown parameter {name!r}{near_match(name, known or parameters)}")
        if name not in (known or names):
            raise InputError(f"factors: {name} is no switch (those are {', '.join(known)})")
    return names


def fidelity_factor(simulator: Simulator, file: StudyFile) -> dict[str, FactorTable]:
    """The factor with all models of the scene, if a multifidelity study does not list models."""
    name = file.design.fidelity
    if file.design.kind != "multifidelity" or name in file.factors:
        return {}
    if name in file.base:
        raise InputError(f"fidelity: {name} is a base value, so there is only one model; remove it from [base]")
    if name != "model" or not simulator.model_names:
        raise InputError(
            f"fidelity: add [factors.{name}] with values, from the cheapest model to the one that counts as the truth, "
            "or name the factor that has them"
        )
    return {name: FactorTable(values=list(simulator.model_names))}
