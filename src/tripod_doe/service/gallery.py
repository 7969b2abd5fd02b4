"""Studies to start from: the templates, and the studies that come with the project."""

from __future__ import annotations

import sys
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError
from tripod_doe.study.template import TEMPLATES

__all__ = ["gallery", "gallery_text"]

_TEMPLATE_NAMES = {
    "grid": "Grid of joint angle and torque",
    "sensitivity": "Which parameter matters most",
    "contribution": "Which friction causes the thrust",
}


def gallery() -> list[dict[str, str]]:
    """All studies to start from that need no other file: ``id``, ``name`` and ``question`` of each."""
    found = [_told(f"template-{kind}", _template(kind)) | {"name": _TEMPLATE_NAMES[kind]} for kind in TEMPLATES]
    for path in _study_files():
        text = path.read_text(encoding="utf-8")
        head: dict[str, Any] = tomllib.loads(text)
        if "function" not in head["study"] and "table" not in head.get("design", {}):
            found.append(_told(path.stem, text))
    return found


def gallery_text(name: str) -> str:
    """The text of one of them.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    kind = name.removeprefix("template-")
    if name != kind and kind in TEMPLATES:
        return _template(kind)
    paths = {path.stem: path for path in _study_files()}
    if name not in paths:
        raise InputError(f"gallery: {name[:100]!r}: no study of this name")
    return paths[name].read_text(encoding="utf-8")


def _template(kind: str) -> str:
    text = (files("tripod_doe.study") / "templates" / f"{kind}.toml").read_text(encoding="utf-8")
    return text.replace("NAME", "my_joint")


def _told(name: str, text: str) -> dict[str, str]:
    head = tomllib.loads(text)["study"]
    return {"id": name, "name": head["name"], "question": head.get("question", "")}


def _study_files() -> list[Path]:
    """The project's studies: of an installation, or of the clone that this is run from."""
    places = (Path(sys.prefix) / "share" / "tripod-doe" / "studies", Path(__file__).parents[3] / "studies")
    return next((sorted(place.glob("*.toml")) for place in places if place.is_dir()), [])
