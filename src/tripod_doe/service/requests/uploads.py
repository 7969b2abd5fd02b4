"""What a client uploads: texts by plain names.

What its studies and workflows may name is decided where they are read (`tripod_doe.study.definition.study_folder`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tripod_doe.errors import ForbiddenError, TooLargeError
from tripod_doe.service.limits import Limits

STUDY, WORKFLOW = "study.toml", "workflow.toml"
"""Names under which the submitted text itself is kept."""


def main_file(kind: str) -> str:
    """Name of the submitted text of a "study" or a "workflow"."""
    return WORKFLOW if kind == "workflow" else STUDY


_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
_SHOWN = 100  # characters of a name in a message


def upload_texts(body: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """The main file of a request and all its texts by name: ``{"study": text, "files": {name: text}}`` or a workflow.

    Raises:
        ForbiddenError: If a file's name is not a plain one.
    """
    main = WORKFLOW if body.get("workflow") is not None else STUDY
    texts = {main: str(body["workflow" if main == WORKFLOW else "study"])}
    for name, text in (body.get("files") or {}).items():
        _check_plain(name, "files")
        if name == main:
            raise ForbiddenError(f"files: {name}: this is the name of the submitted file itself; choose another")
        texts[name] = text
    return main, texts


def write_upload(folder: Path, texts: Mapping[str, str]) -> None:
    """Write uploaded texts into a folder of their own."""
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="")


def refuse_many_files(texts: Mapping[str, str], limits: Limits) -> None:
    """Refuse (TooLargeError) an upload of more files than are taken."""
    if len(texts) - 1 > limits.files:
        raise TooLargeError(f"files: {len(texts) - 1:,} files; at most {limits.files:,} are taken here")


def _check_plain(name: str, where: str) -> None:
    if not _PLAIN.fullmatch(name) or ".." in name:
        raise ForbiddenError(f"{where}: {name[:_SHOWN]!r}: a plain name is needed: letters, digits, dots, - and _")
