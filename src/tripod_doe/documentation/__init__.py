"""The documentation that a wheel brings along: the site that `sphinx-build` makes of ``docs/``, next to this file.

Wheels get it as they are built (``docs/wheel_with_site.py``), so reading it needs neither network nor Sphinx. An
editable installation has none until the site is built into it.
"""

from pathlib import Path

BUILD = "sphinx-build docs src/tripod_doe/documentation/site"
"""Builds the site into an editable installation, from the folder of the repository."""

INSTALL = "pip install -e '.[docs]'"
"""Installs what building it needs."""

_SITE = Path(__file__).parent / "site"


def site_folder() -> Path | None:
    """The folder with the site's `index.html`; None where it has not been built."""
    return _SITE if (_SITE / "index.html").is_file() else None
