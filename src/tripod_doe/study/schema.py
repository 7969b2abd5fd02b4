"""The schema of study files, made from the checked tables and from the parameters' metadata."""

from __future__ import annotations

from typing import Any

from tripod_doe.study.accuracy import AUTO
from tripod_doe.study.file import StudyFile
from tripod_doe.study.scenes import SCENES, load_simulator

__all__ = ["study_schema"]


def study_schema(scene: str = "joint") -> dict[str, Any]:
    """JSON Schema of study files of a scene: every table and key, and every parameter with unit, range and source."""
    schema = StudyFile.model_json_schema()
    simulator = load_simulator(scene)
    described = {}
    for parameter in simulator.parameters.values():
        entry: dict[str, Any] = {
            "description": f"{parameter.meaning} ({parameter.unit_text or '-'}; {parameter.range_text})",
            "unit": parameter.unit,
            "symbol": parameter.symbol,
            "source": parameter.source,
            "default": parameter.default,
        }
        if parameter.kind == "choice":
            entry["enum"] = [
                *parameter.choices,
                *([AUTO] if parameter.name == "model" and simulator.candidates else []),
            ]
        else:
            entry["type"] = {"number": ["number"], "switch": ["integer", "boolean"]}.get(parameter.kind, ["integer"])
            limits = {"exclusiveMinimum" if parameter.low_open else "minimum": parameter.low, "maximum": parameter.high}
            entry |= {key: value for key, value in limits.items() if abs(value) != float("inf")}
        described[parameter.name] = entry
    schema["properties"]["base"] |= {"properties": described, "additionalProperties": False}
    factors = schema["properties"]["factors"]
    factors["properties"] = {name: {"$ref": "#/$defs/FactorTable"} for name in described}
    factors["additionalProperties"] = False
    sub_designs = schema["properties"].pop("designs")["additionalProperties"]
    schema["properties"]["design"] = {  # a file writes them [design.NAME]
        "description": schema["$defs"]["DesignTable"]["description"],
        "type": "object",
        "properties": schema["$defs"]["DesignTable"]["properties"],
        "additionalProperties": sub_designs,
    }
    schema["x-scenes"] = sorted(SCENES)
    schema["x-outputs"] = {
        output.name: {"unit": output.unit, "dims": list(output.dims), "description": output.meaning}
        for output in simulator.outputs.values()
    }
    return schema
