"""A small finished study for the first look at a new folder."""

from __future__ import annotations

import json
import sys
import time
import tomllib
from importlib.resources import files

from tripod_doe.service.service import Service

_LOOK = 0.1  # seconds between two looks


def add_demo(service: Service) -> None:
    """Run the demonstration study, unless the folder has it; ends when it is finished.

    Parameters
    ----------
    service
        Started, and not read-only.
    """
    text = (files("tripod_doe.service") / "demo.toml").read_text(encoding="utf-8")
    name = tomllib.loads(text)["study"]["name"]
    if any(run.name == name for run in service.runs.all()):
        return
    print(f"tripod-doe: running the study {name!r} for the first look", file=sys.stderr)
    run = service.submit(json.dumps({"study": text}).encode())
    while not service.runs.find(run.id).state.at_rest:
        time.sleep(_LOOK)
