"""Files to start from: templates, and studies, workflows, optimisations and fits of the project, ready to submit."""

import json
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError
from tripod_doe.service.requests.uploads import KINDS
from tripod_doe.study.definition.template import TEMPLATES, examples_place
from tripod_doe.study.definition.toml_text import toml_text

_TEMPLATE_NAMES = {
    "grid": "Grid of joint angle and torque",
    "sensitivity": "Which parameter matters most",
    "contribution": "Which friction causes the thrust",
    "response-surface": "Effects and curvature from few points",
    "tolerance": "Which tolerance to tighten first",
    "what-if": "A page with sliders",
    "multifidelity": "Several models at once",
}
_ANGLE = "joint_angle_deg"
_NAMED_FILE = re.compile(r'\b(study|table|measurement)(\s*=\s*)"([^"\n]+\.(?:toml|csv))"')
_RECORD = re.compile(r"^([^,\n]+\.csv)\b", re.MULTILINE)  # first cells of a table of records


@cache
def gallery() -> list[dict[str, str]]:
    """All files to start from: ``id``, ``kind``, ``name`` and ``question`` of each file."""
    entries = [_entry(f"template-{kind}", _template(kind)) | {"name": _TEMPLATE_NAMES[kind]} for kind in TEMPLATES]
    for name, path in _files().items():
        text = path.read_text(encoding="utf-8")
        if "function" not in tomllib.loads(text).get(_kind(text), {}):
            entries.append(_entry(name, text))
    return entries


def gallery_upload(name: str) -> dict[str, Any]:
    """One gallery file, ready to submit: ``study`` or ``workflow``, and the ``files`` it names, by plain names.

    Raises:
        InputError: If there is no such file.
    """
    kind = name.removeprefix("template-")
    if name != kind and kind in TEMPLATES:
        return {"study": _template(kind), "files": {}}
    if name not in {entry["id"] for entry in gallery()}:
        raise InputError(f"gallery: {name[:100]!r}: no study or workflow of this name")
    texts: dict[str, str] = {}
    text = _plain_text(_files()[name], texts)
    for table in [texts[name] for name in texts if _kind(text) == "fit"]:  # a table of records names their files
        places = {record: _files()[name].parent / record for record in _RECORD.findall(table)}
        texts |= {record: path.read_text(encoding="utf-8") for record, path in places.items() if path.is_file()}
    return {_kind(text): text, "files": texts}


def _plain_text(path: Path, texts: dict[str, str]) -> str:
    """The text of a file, with plain names for the files that it names; adds their texts to `texts`."""

    def plain(match: re.Match[str]) -> str:
        places = (path.parent, path.parent.parent / "studies")  # a workflow may name a table of a study
        other = next((place / match[3] for place in places if (place / match[3]).is_file()), None)
        if other is None:
            return match[0]
        if other.name not in texts:
            texts[other.name] = ""  # else files that name each other would loop
            texts[other.name] = _plain_text(other, texts)
        return f'{match[1]}{match[2]}"{other.name}"'

    text = path.read_text(encoding="utf-8")
    return _NAMED_FILE.sub(plain, text) if path.suffix == ".toml" else text


def _kind(text: str) -> str:
    tables = tomllib.loads(text)
    return next((kind for kind in KINDS if kind in tables), "study")


def _template(kind: str) -> str:
    text = (files("tripod_doe.study.definition") / "templates" / f"{kind}.toml").read_text(encoding="utf-8")
    return text.replace("NAME", "my_joint")


def _entry(name: str, text: str) -> dict[str, str]:
    kind = _kind(text)
    head = tomllib.loads(text)[kind]
    return {"id": name, "kind": kind, "name": head["name"], "question": head.get("question", "")}


def _files() -> dict[str, Path]:
    """The project's files by their ids, from the installation or from the clone that runs this code."""
    place = examples_place()
    if place is None:
        return {}
    studies = {path.stem: path for path in sorted((place / "studies").glob("*.toml"))}
    others = (
        ("workflow", "workflows/*.toml"),
        ("optimisation", "optimisations/*.toml"),
        ("fit", "measurements/*/*.toml"),
    )
    return studies | {f"{kind}-{path.stem}": path for kind, names in others for path in sorted(place.glob(names))}


def study_of_joint(name: str, base: str, candidate: int | None, search: Mapping[str, Any]) -> str:
    """A study of the joint of a search's result at its operating points; over the joint angle where there is none.

    Args:
        name: Name of the search's run.
        base: The result's table [base].
        search: The file of the search.
        candidate: Number on a front; None for the joint of a fit, or at the knee.
    """
    which = "" if candidate is None else f", candidate {candidate}"
    head = json.dumps(f"{name}{which}", ensure_ascii=False)
    tables = search.get("at", {}).items()
    at = {each: table["values"] for each, table in tables if isinstance(table, dict) and "values" in table}
    if not at:
        own = tomllib.loads(base)["base"].get(_ANGLE)
        at = {_ANGLE: [4, 8, 12] if own is None else [own]}
    lines = [line for line in base.splitlines() if line.partition(" ")[0] not in at]
    factors = toml_text({"factors": {each: {"values": values} for each, values in at.items()}})
    return "\n".join(["[study]", f"name = {head}", "", *lines, "", factors])
