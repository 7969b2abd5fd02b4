"""The schema of study files, made from the checked tables and from the parameters' metadata."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel

from tripod_doe.study.definition.accuracy_table import AUTO
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file_schema import TABLES, StudyFile


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
    schema["x-models"] = {name: simulator.describe_model(name) for name in simulator.model_names}
    schema["x-scenes"] = sorted(SCENES)
    schema["x-outputs"] = {
        output.name: {"unit": output.unit, "dims": list(output.dims), "description": output.meaning}
        for output in simulator.outputs.values()
    }
    return schema


def brief_schema(scene: str = "joint") -> str:
    """Keys of a study file and parameters and outputs of a scene for people: one line each."""
    simulator = load_simulator(scene)
    blocks = [(f"[{table}]", _key_lines(model)) for table, model in TABLES.items()]
    groups: dict[str, list[tuple[str, ...]]] = {}
    for parameter in simulator.parameters.values():
        default = "" if parameter.default is None else f"{parameter.default}"
        line = (parameter.name, default, parameter.unit_text or "-", parameter.meaning, parameter.range_text)
        groups.setdefault(parameter.group, []).append(line)
    blocks += [(f"parameters: {group} (name, default, unit, meaning, range)", lines) for group, lines in groups.items()]
    outputs: list[tuple[str, ...]] = [
        (output.name, output.unit_text or "-", output.meaning + (f" ({', '.join(output.dims)})" if output.dims else ""))
        for output in simulator.outputs.values()
    ]
    blocks.append((f"outputs of the scene {scene} (name, unit, meaning and dimensions)", outputs))
    return "\n\n".join("\n".join([title, *_aligned(lines)]) for title, lines in blocks)


def _key_lines(table: type[BaseModel]) -> list[tuple[str, ...]]:
    lines: list[tuple[str, ...]] = []
    for name, field in table.model_fields.items():
        words = re.findall(r"'([^']+)'", str(field.annotation)) if "Literal" in str(field.annotation) else []
        lines.append((name, (field.description or "") + (f": {', '.join(words)}" if words else "")))
    return lines


def _aligned(lines: list[tuple[str, ...]]) -> list[str]:
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return ["  " + "  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]
