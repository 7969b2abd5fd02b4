"""Page rendering: the templates, and functions that put values into words."""

import json
from datetime import datetime
from functools import cache
from importlib.metadata import version
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from starlette.responses import HTMLResponse

from tripod_doe.number_text import duration, in_words, number, size
from tripod_doe.page_parts.markdown import markdown
from tripod_doe.service.explorer.view import selected_text
from tripod_doe.service.page.asset_files import stamp
from tripod_doe.service.runs.run_table import Run
from tripod_doe.service.security import content_policy
from tripod_doe.service.settings import Settings

HELP = {
    "Runs": "reference/service_page.html",
    "New study": "reference/studies.html",
    "Extend": "guides/add_levels.html",
    "Measurement": "guides/is_it_like_my_record.html",
    "Differences": "guides/is_this_difference_real.html",
    "Explore": "reference/service_page.html#exploring-a-cube",
    "Analyses": "guides/which_parameter.html",
    "Report": "guides/read_a_report.html",
    "Failed points": "guides/some_points_failed.html",
    "Study": "reference/file_keys.html",
    "File": "reference/file_keys.html",
    "Steps": "reference/workflows.html",
    "Progress": "guides/how_long_will_it_take.html",
    "Result": "guides/read_a_report.html",
    "Share": "guides/show_it_to_a_colleague.html",
    "Variables by formula": "guides/an_output_that_is_not_there.html",
}
"""Pages of the documentation on the parts of our pages."""

_PAGES = (("/", "Runs"), ("/new", "New study"), ("/compare", "Measurement"), ("/diff", "Differences"))


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("tripod_doe.service.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = {
        "duration": duration,
        "selected_text": selected_text,
        "round_level": number,
        "size": size,
        "to_come": _to_come,
        "day": _day,
        "words": in_words,
        "in_file": _in_file,
        "markdown": markdown,
    }
    environment.filters |= words
    environment.globals |= {"version": stamp(), "plotly": version("plotly"), "help_on": _help_on}
    return environment


def show(template: str, settings: Settings, here: str = "", root: str | None = None, **values: Any) -> HTMLResponse:
    """A whole page; `root` is empty for a client without a session."""
    root = settings.root if root is None else root
    pages = [page for page in _PAGES if not (settings.read_only and page[0] in ("/new", "/compare"))]
    pages = [] if settings.only_run else pages
    text = part(template, pages=pages, here=here, root=root, read_only=settings.read_only, **values)
    return HTMLResponse(text, headers={"content-security-policy": content_policy.PAGES})


def part(template: str, **values: Any) -> str:
    """A part of a page, as text."""
    return _templates().get_template(template).render(**values)


def _help_on(part: str) -> Markup:
    """A link from a part of a page to its page of the documentation."""
    link = (
        '<a class="help-on" href="/help/{}" target="_blank" title="Help: {}">?<span class="unseen"> Help: {}</span></a>'
    )
    return Markup(link).format(HELP[part], part, part)


def _to_come(run: Run) -> str:
    """CPU time that the missing points will need, estimated from the finished points or from the plan."""
    if not run.counts.missing:
        return ""
    ended = run.counts.total - run.counts.missing
    if ended:
        return f"about {duration(run.counts.cpu_seconds / ended * run.counts.missing, 2)}"
    price = run.plan.get("cpu_seconds")
    return f"about {duration(price['mean'], 2)}" if price else "not known"


def _in_file(value: object) -> str:
    """A value as in a study file; a dash if it is not set."""
    if value is None:
        return "-"
    return selected_text(value) if isinstance(value, str | float) else json.dumps(value)


def _day(stamp: str) -> str:
    """A UTC time in the form of the lists."""
    return datetime.fromisoformat(stamp).strftime("%Y-%m-%d %H:%M UTC")
