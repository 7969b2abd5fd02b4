"""Builds wheels that bring the documentation along: setuptools, with the site built first.

Only wheels pay for it, by Sphinx in the environment that pip makes for the build; editable installations need none. A
wheel whose site cannot be built is built without it, since it computes all the same.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from setuptools.build_meta import (  # noqa: F401  # the rest of the interface is setuptools' own
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)
from setuptools.build_meta import build_wheel as _build_wheel

_DOCS = Path(__file__).parent
_SITE = _DOCS.parent / "src" / "tripod_doe" / "documentation" / "site"


def get_requires_for_build_wheel(config_settings: dict[str, str] | None = None) -> list[str]:
    """What builds the site, as `pyproject.toml` lists it for everybody."""
    import tomllib

    project = tomllib.loads((_DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return list(project["optional-dependencies"]["docs"])


def build_wheel(
    wheel_directory: str, config_settings: dict[str, str] | None = None, metadata_directory: str | None = None
) -> str:
    """Build the site, then the wheel with it."""
    for before in (_SITE, _DOCS.parent / "build" / "lib" / _SITE.relative_to(_DOCS.parent / "src")):
        shutil.rmtree(before, ignore_errors=True)
    if find_spec("sphinx") and find_spec("myst_parser") and find_spec("furo"):
        words = ["-q", "-j", "auto", "-d", str(_DOCS.parent / "build" / "doctrees"), str(_DOCS), str(_SITE)]
        if subprocess.run([sys.executable, "-m", "sphinx", *words]).returncode:
            print("the documentation could not be built: the wheel has none", file=sys.stderr)
    else:
        print("Sphinx, MyST or furo is missing: the wheel has no documentation", file=sys.stderr)
    return str(_build_wheel(wheel_directory, config_settings, metadata_directory))
