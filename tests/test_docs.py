"""The documentation is true: tables match the code, links and named files exist, every command is shown."""

from __future__ import annotations

import io
import itertools
import re
import shlex
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from generate import texts

import tripod_doe as td
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.registry import ANALYSES, FIGURES
from tripod_doe.cli.main import build_parser
from tripod_doe.joint.known_errors.error_estimate import COMPARED, RECORDED
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.simulator import simulator as joint
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file_schema import DesignKind

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def table(page, mark):
    """Cells of the table below a mark of a page, row by row, without its head."""
    text = (ROOT / "docs" / page).read_text()
    assert f"<!-- {mark} -->\n" in text
    lines = text.partition(f"<!-- {mark} -->\n")[2].partition("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


def test_the_readme_is_short_and_names_every_command():
    readme = (ROOT / "README.md").read_text()
    assert len(readme.split()) <= 1000
    for command in build_parser(["simulate"])._subparsers._group_actions[0].choices:
        assert f"tripod-doe {command}" in readme, command


def test_links_and_named_files_exist():
    """Links, and the study and workflow files and folders of this repository that commands name."""
    for page in PAGES:
        text = page.read_text()
        for target in re.findall(r"\]\((?!http)([^)#]+)", text):
            assert (page.parent / target).exists(), f"{page}: {target}"
        for target in re.findall(r"(?<![\w/])(?:studies|workflows|benchmarks|docs|tests)/[\w/]+\.\w+", text):
            assert (ROOT / target).exists(), f"{page}: {target}"


def test_the_index_leads_to_every_page():
    listed = re.findall(r"\]\(([^)#]+)", (ROOT / "docs" / "index.md").read_text())
    assert sorted(set(listed)) == sorted(
        {page.relative_to(ROOT / "docs").as_posix() for page in PAGES[1:]} - {"index.md"}
    )


def test_tables_are_whole():
    """Rows below an empty line belong to no table: a page shows them as text."""
    for page in PAGES:
        lines = page.read_text().splitlines()
        for before, line, after in zip(["", *lines], lines, [*lines[1:], ""], strict=False):
            if line.startswith("|") and not before.startswith("|"):
                assert after.startswith("| ---"), f"{page}: {line}"


@pytest.mark.slow
def test_the_generated_pages_are_those_of_the_code():
    """Exact, so every command, key, parameter, output, public name and route is there."""
    for name, text in texts().items():
        page = (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
        assert page == text, f"{name} is out of date: run python docs/reference/generate.py"


def test_every_analysis_and_figure_of_a_workflow_is_listed():
    assert {name for row in table("reference/workflows.md", "figures") for name in names(row[0])} == set(FIGURES)
    of_workflows = {name for row in table("reference/workflows.md", "workflow analyses") for name in names(row[0])}
    assert of_workflows == {kind for kind, analysis in ANALYSES.items() if not analysis.designs}


@pytest.mark.parametrize("command", ["run", "plan", "query", "compare", "workflow", "serve", "schema", "init"])
def test_every_flag_of_a_command_is_shown(command):
    shown = "".join(page.read_text() for page in PAGES)
    parser = build_parser([command])._subparsers._group_actions[0].choices[command]
    for action in parser._actions:
        for flag in action.option_strings:
            assert flag in ("-h", "--help") or flag in shown, flag


def calls(text):
    """Words of each call of our command in the code blocks of a page that are not shown to be refused."""
    for block in re.findall(r"(?<!exit code 2 -->\n)^```(?:bash|sh)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for call in re.findall(r"(?:^|&& |bin/)tripod-doe (.*)", block.replace("\\\n", " "), re.MULTILINE):
            words = shlex.shlex(call, posix=True, punctuation_chars="&|;<>")
            words.whitespace_split = True
            yield list(itertools.takewhile(lambda word: word[0] not in "&|;<>", words))


def test_every_command_of_a_page_exists():
    """Commands, flags and the number of their arguments, as the command line reads them; nothing runs."""
    for page in PAGES:
        for words in calls(page.read_text()):
            if words[-1] not in ("--help", "--version"):
                _, unknown = build_parser(words).parse_known_args(words)
                assert not unknown, f"{page}: {words}"


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_the_picture_shows_what_its_study_gives(tmp_path):
    """Regression: the numbers inside the picture, to the 1e-6 that the default model's balance is solved to."""
    drawn = (ROOT / "docs" / "pictures" / "thrust_map.svg").read_text().partition("<!--\n")[2].partition("-->")[0]
    td.run(ROOT / "studies" / "thrust_map.toml", tmp_path / "map", workers=0, progress=False)
    found = effect_charts(td.open_cube(tmp_path / "map"))[0].charts[0].data
    numbers = pd.read_csv(io.StringIO(drawn))
    assert list(numbers.columns) == list(found.columns)
    assert numbers.to_numpy() == pytest.approx(found.to_numpy(), rel=1e-4)
    angle, curve = found.iloc[:, 0].to_numpy(), found.iloc[:, -1].to_numpy()
    straight = np.polyval(np.polyfit(angle[4:], curve[4:], 1), 2)
    assert curve[0] < 0.8 * straight  # at small angles it bends


def test_models_and_what_they_ignore():
    assert [row[0] for row in table("explanation/models.md", "models")] == [f"`{name}`" for name in MODELS]
    for name, ignored in table("reference/models.md", "ignored parameters"):
        assert set(names(ignored)) == MODELS[name.strip("`")].ignores


def test_the_ranges_of_the_models_are_those_of_the_code():
    told = [
        (f"`{name}`", f"{valid.quantity}{f' ({valid.meaning})' * bool(valid.meaning)} {valid.ends}", valid.reason)
        for name, model in MODELS.items()
        for valid in model.valid
    ]
    assert [tuple(row) for row in table("reference/models.md", "ranges")] == told


def test_the_measured_errors_are_those_of_the_record():
    """Exact: medians and ninth deciles over the joint angle, as printed."""
    record = pd.read_csv(RECORDED, comment="#")
    rows = table("reference/models.md", "measured errors")
    for angle, *cells in rows:
        low, high = (float(end) for end in re.findall(r"[\d.]+", angle))
        part = record[record["joint_angle_deg"].between(low, high, inclusive="left")]
        for model, cell in zip(COMPARED, cells, strict=True):
            errors = 100 * part[model].abs().dropna()
            median, decile = (f"{float(f'{value:.2g}'):g}" for value in (errors.median(), errors.quantile(0.9)))
            assert cell == f"{median} ({decile}), {errors.size} points"


def test_which_model_computes_which_output():
    thrust = {name for name in joint.outputs if "thrust" in name} - {
        "thrust_amplitude_scatter",
        "thrust_amplitude_error",
        "thrust_amplitude_by_cycle",
        "thrust_amplitude_settled",
        "thrust_amplitude_step_error",
    }
    computed = {name: set(thrust) for name in MODELS}
    for outputs, _, *cells in table("reference/outputs.md", "outputs"):
        for model, cell in zip(MODELS, cells, strict=True):
            computed[model] |= set(names(outputs)) if cell == "yes" else set()
    assert computed == {name: model.outputs for name, model in MODELS.items()}


def test_outcomes_and_designs_are_listed():
    assert [names(row[0])[0] for row in table("reference/outputs.md", "outcomes")] == [
        outcome.label for outcome in Outcome
    ]
    assert {name for row in table("reference/studies.md", "designs") for name in names(row[0])} == set(
        get_args(DesignKind)
    )


def test_the_glossary_has_every_name_once():
    """Names of the code stand in its second column: none is missing, none is stale, none has two senses."""
    rows = [
        line.split("|")
        for line in (ROOT / "docs" / "reference" / "glossary.md").read_text().splitlines()
        if line[:2] == "| "
    ]
    listed = [name for row in rows for name in names(row[2])]
    simulators = [load_simulator(name) for name in SCENES]
    known = {*SCENES, *MODELS, "newton", *METHODS, *(outcome.label for outcome in Outcome), *get_args(DesignKind)}
    for simulator in simulators:
        known |= {*simulator.parameters, *simulator.outputs}
        known |= {dimension.name for output in simulator.outputs.values() for dimension in output.dimensions}
    assert sorted(listed) == sorted({*known, "point"})
    terms = [row[1].strip() for row in rows]
    assert len(set(terms) - {"term", "---"}) == len([term for term in terms if term not in ("term", "---")])


def test_the_glossary_has_every_statistic():
    text = (ROOT / "docs" / "reference" / "glossary.md").read_text()
    for statistic in joint.labels(["needle_skew_summary_deg"], {"cycles": 4})["statistic"]:
        assert f"`{statistic}`" in text


def test_the_stops_of_the_walk_exist():
    """Every row of the walk names a file and a function, class or table that it defines."""
    text = (ROOT / "docs" / "explanation" / "walk.md").read_text()
    stops = re.findall(r"^\|[^|`]*(?:`[^`]*`[^|`]*)*\| `([\w/]+\.py)` \| `(\w+)` \|$", text, re.MULTILINE)
    assert len(stops) == len([line for line in text.splitlines() if line.startswith("| ")]) - 2 * text.count("| stop |")
    for file, name in stops:
        source = (ROOT / "src" / "tripod_doe" / file).read_text()
        assert re.search(rf"^\s*(?:def|class) {name}\b|^{name}\b.* = ", source, re.MULTILINE), f"{file}: {name}"
    for file in re.findall(r"`([\w/]+\.py)`", text):
        assert (ROOT / "src" / "tripod_doe" / file).exists(), file
