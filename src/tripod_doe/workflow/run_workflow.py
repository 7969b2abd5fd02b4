"""Run a workflow: one step after the other, each after the steps that it needs; finished steps do not run again.

This process computes the points of small studies; worker processes, which all study steps share, compute the points of
larger ones, see `tripod_doe.study.execution`. At most `workers` processes are busy: this process waits while workers
compute, and workers are idle while it analyses or draws.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from tripod_doe.analyses.registry import ANALYSES, draw
from tripod_doe.errors import InputError, StorageError
from tripod_doe.files.atomic_files import refuse_links
from tripod_doe.files.checksum_list import checksums, refuse_changed, remove_listed, remove_pages, write_listed
from tripod_doe.files.regular_files import STUDY_BYTES, read_regular
from tripod_doe.names import path_within
from tripod_doe.number_text import capital, duration
from tripod_doe.process.interrupts import check_interrupt
from tripod_doe.reports.workflow_report import StepView, chain_page, step_page, write_charts
from tripod_doe.study.cube.file_digest import is_sealed, stored_digest
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import failure_lines
from tripod_doe.study.result_directory.check import check_files
from tripod_doe.study.result_directory.directory import make_directory
from tripod_doe.study.result_directory.directory_lock import DirectoryLock
from tripod_doe.study.result_directory.latest_run import FOUND, found_in
from tripod_doe.study.result_directory.open_cube import is_shown, opened_cube
from tripod_doe.workflow.run_study import run_on
from tripod_doe.workflow.steps_file import write_steps
from tripod_doe.workflow.workflow import Step, Workflow, fed_study, load_workflow
from tripod_doe.workflow.workflow_file import AnalysisStep, FigureStep, ReportStep, StudyStep

_STEP = "step.json"  # the record of a finished step
_MARKS = {"study": "cube.nc", "figure": "figures.json", "report": "index.html"}


@dataclass(frozen=True)
class WorkflowSummary:
    """Results of a workflow."""

    directory: Path  # result directory
    page: Path  # page of the workflow
    steps: tuple[StepView, ...]  # state of every step, each after the steps that it needs
    reports: tuple[Path, ...] = ()  # pages of its report steps that show its results as they are

    @property
    def good(self) -> bool:
        """Whether no step failed, and none waits for a failed step."""
        return not any(step.state in ("failed", "blocked") for step in self.steps)


def run_workflow(
    path: str | Path,
    out: str | Path,
    *,
    only: str | None = None,
    quick: bool = False,
    workers: int | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    oversubscribe: bool = False,
    untrusted: bool = False,
    take_over: bool = False,
) -> WorkflowSummary:
    """Run the missing steps of a workflow, then make its page.

    A step that was finished from the same inputs is not run again: its hash is taken over its text, the text of its
    study, the kernels or the analysis' code, the files it reads, and the hashes of its inputs. It also runs again
    where another command has written its cube since. A failed step stops only the steps that need it; a killed study
    step continues at its next unfinished point. One process at a time runs a workflow in a directory.

    Args:
        path: The workflow file.
        out: Result directory: steps/NAME for each step (quick/NAME in a quick run), report/index.html.
        only: Run only this step and the steps that it needs.
        quick: Apply the overrides of [quick].
        workers: Worker processes that all study steps share, started by the first that needs them; see `run`.
        retry_failed: Run failed points again.
        progress: Whether to print each step to standard error, with a progress bar for studies.
        oversubscribe: Allow more workers than this machine has processors.
        untrusted: For a file from a stranger: refuse functions, and files outside of its folder.
        take_over: Take the lock of a process that is known to be dead.

    Raises:
        InputError: If the workflow file or the directory cannot be used; nothing is started. Also if another command
            changes results that the page of the workflow shows while it is made.
        StorageError: If writing fails; finished steps and points are kept.
    """
    workflow = load_workflow(path, quick, StudyFolder.of(path, untrusted))
    wanted = list(workflow.steps) if only is None else workflow.needed_for(only)
    directory = make_directory(out)
    refuse_links(directory / ("quick" if quick else "steps"))
    lock = DirectoryLock(directory, take_over)
    try:
        remove_pages(directory)
        with Execution(workers, oversubscribe=oversubscribe) as execution:
            chain = _Chain(workflow, directory, execution, retry_failed, progress, take_over)
            views = chain.run(wanted)
        return _summary(chain, views)
    finally:
        lock.release()


def _summary(chain: _Chain, views: dict[str, StepView]) -> WorkflowSummary:
    """Make the page of a workflow from its steps, with the steps that this run left out."""
    workflow, directory = chain.workflow, chain.directory
    for name in workflow.steps.keys() - views.keys():
        views[name] = chain.recorded(workflow.steps[name]) or chain.view(workflow.steps[name], "not selected")
    steps = tuple(views[name] for name in workflow.steps)
    head = workflow.file.workflow
    with chain.answers(steps) as answers:
        figures = chain.figures(steps)
        text = chain_page(
            head.name,
            head.question,
            steps,
            notice=_notice(workflow),
            text=workflow.text,
            answers=answers,
            figures=figures,
        )
    current = (step.name for step in steps if step.kind == "report" and step.state in ("finished", "reused"))
    reports = tuple(chain.folder(name) / "index.html" for name in current)
    return WorkflowSummary(directory, write_listed(directory / "report" / "index.html", text), steps, reports)


def _notice(workflow: Workflow) -> str:
    """The changes of --quick in a sentence; empty without it."""
    if not workflow.quick:
        return ""
    settings: list[str] = []

    def walk(path: str, value: object) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                walk(f"{path}.{key}", item)
        else:
            settings.append(f"{path} = {value}")

    for step, table in workflow.file.quick.items():
        walk(step, table.model_dump(exclude_unset=True, exclude_none=True))
    if not settings:
        return "The file has no [quick]: these are the studies of a run without --quick."
    changes = ", ".join(settings)
    return f"Quick run: smaller studies, whose numbers are not results. Changed in the study files: {changes}."


class _Chain:
    """One run of a workflow: the folders of its steps, and the workers that its studies share."""

    def __init__(
        self,
        workflow: Workflow,
        directory: Path,
        execution: Execution,
        retry_failed: bool,
        progress: bool,
        take_over: bool,
    ) -> None:
        self.workflow, self.directory = workflow, directory
        self.retry_failed, self.progress, self._take_over = retry_failed, progress, take_over
        self._execution = execution
        self._states: dict[str, dict[str, object]] = {}
        self._made: dict[str, str] = {}  # digest of the cube of each step that this run made or reuses
        self._found: dict[str, str] = {}  # sentence on the points that the study of a step looks for

    def run(self, wanted: list[str]) -> dict[str, StepView]:
        """Run these steps; each must come after the steps that it needs."""
        views: dict[str, StepView] = {}
        for name in wanted:
            views[name] = self._run_step(name, [views[other] for other in self.workflow.steps[name].inputs])
        return views

    def folder(self, name: str) -> Path:
        """The folder of a step; quick runs have folders of their own, so that they never count as results."""
        return path_within(self.directory, "quick" if self.workflow.quick else "steps", name)

    def view(self, step: Step, state: str, seconds: float | None = None, detail: str = "") -> StepView:
        """A step as the page shows it."""
        kind = step.analysis if isinstance(step.table, AnalysisStep) else step.table.kind
        page = {"study": "report/index.html", "report": "index.html", "figure": ""}.get(step.table.kind, "cube.nc")
        link = Path("..") / self.folder(step.name).relative_to(self.directory) / page
        made = state in ("finished", "reused") or (state == "failed" and (self.folder(step.name) / page).is_file())
        return StepView(step.name, kind, step.inputs, state, seconds, detail, link.as_posix() if made else "")

    def recorded(self, step: Step) -> StepView | None:
        """A step that an earlier run finished from the same inputs; None if there is none."""
        folder = self.folder(step.name)
        try:
            record = json.loads(read_regular(folder / _STEP, STUDY_BYTES))
            of, cube = record["hash"], record["cube"]
            seconds, detail = float(record["seconds"]), str(record["detail"])
        except (OSError, ValueError, KeyError, TypeError, InputError):  # missing or damaged: the step runs again
            return None
        marks = [*self._marks(step), *self._exported(step)]
        if of != step.hash or not all(mark.exists() for mark in marks):
            return None
        try:
            for mark in self._exported(step):
                refuse_changed(mark, unlisted=True)
            if step.study is None and not {mark.name for mark in self._marks(step)} <= checksums(folder).keys():
                return None
            if cube != self._digest(step.name):  # `run` or `derive` wrote other results there
                return None
            if not all(file.is_whole and file.path.exists() for file in check_files(folder)):
                return None
        except InputError:
            return None
        if any(mark.suffix == ".nc" and not is_sealed(mark) for mark in marks):
            return None
        self._made[step.name] = cube
        return self.view(step, "reused", seconds, detail)

    def _marks(self, step: Step) -> list[Path]:
        """Files without which a step is not finished."""
        names = [_MARKS.get(step.table.kind, "cube.nc")]
        if step.study is not None:
            names += ["study.toml", *(f"analysis/{name}.nc" for name in step.study.file.analysis)]
        return [self.folder(step.name) / name for name in names]

    def _digest(self, name: str) -> str:
        """Digest of the cube of a step; empty without a cube, or where it does not show what its journal holds."""
        cube = self.folder(name) / "cube.nc"
        return stored_digest(cube) if cube.is_file() and is_shown(cube.parent) else ""

    def _run_step(self, name: str, needed: list[StepView]) -> StepView:
        check_interrupt()
        step = self.workflow.steps[name]
        lacking = [view for view in needed if view.state in ("failed", "blocked")]
        stopped = [view.name for view in lacking if not (self._reads_failed(step) and self._has_points(view))]
        if stopped:
            self._remove_exported(step)
            return self._report_state(self.view(step, "blocked", detail=f"needs {', '.join(stopped)}"))
        if not lacking and (view := self.recorded(step)):
            self._found[name] = found_in(self.folder(name))
            return self._report_state(view)
        self._note(self.view(step, "running"))
        if step.study is None:
            remove_listed(self.folder(name))
        self._remove_exported(step)
        started = time.perf_counter()
        try:
            detail = self._make(step)
        except StorageError:
            raise  # a full disk stops everything
        except Exception as error:
            reason = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            return self._report_state(self.view(step, "failed", time.perf_counter() - started, reason))
        seconds = round(time.perf_counter() - started, 3)
        made = self._made.setdefault(name, self._digest(name))
        record = {"hash": step.hash, "cube": made, "seconds": seconds, "detail": detail}
        if lacking:  # missing inputs may come without a change of the hash: the step is not finished
            (self.folder(step.name) / _STEP).unlink(missing_ok=True)
            detail += f", without points that failed in {', '.join(view.name for view in lacking)}"
        else:
            write_listed(self.folder(step.name) / _STEP, json.dumps(record))
        return self._report_state(self.view(step, "finished", seconds, detail))

    def _reads_failed(self, step: Step) -> bool:
        return isinstance(step.table, AnalysisStep) and ANALYSES[step.analysis].partial

    def _has_points(self, view: StepView) -> bool:
        """Whether this run made the cube of a study step, perhaps without all points."""
        return self.workflow.steps[view.name].study is not None and bool(self._made.get(view.name))

    def _report_state(self, view: StepView) -> StepView:
        if self.progress:
            time_text = f" in {duration(view.seconds)}" if view.state in ("finished", "failed") and view.seconds else ""
            print(f"{view.name}: {view.state}{time_text}{': ' if view.detail else ''}{view.detail}", file=sys.stderr)
        self._note(view)
        return view

    def _note(self, view: StepView) -> None:
        """Write the state of a step for readers of `steps_file`."""
        state = {key: getattr(view, key) for key in ("name", "state", "seconds", "detail")}
        sentence = self._found.get(view.name)
        self._states[view.name] = state | ({FOUND: f"{view.name}: {sentence}"} if sentence else {})
        write_steps(self.directory, self._states.values())

    def _make(self, step: Step) -> str:
        """Run a step, and return its result in a few words."""
        makers: Mapping[str, Callable[[Step], str]] = {
            "study": self._run_study,
            "figure": self._draw,
            "report": self._report,
        }
        return makers.get(step.table.kind, self._analyse)(step)

    def _run_study(self, step: Step) -> str:
        study, source = step.study, step.table.table if isinstance(step.table, StudyStep) else ""
        assert study is not None
        if source:
            with self._cubes([source]) as tables:
                study = fed_study(study, tables[source], source)
        summary = run_on(
            self._execution,
            study,
            self.folder(step.name),
            retry_failed=self.retry_failed,
            progress=self.progress,
            take_over=self._take_over,
        )
        self._made[step.name] = summary.digest
        self._found[step.name] = summary.found
        if not summary.good:
            reasons = failure_lines(summary.failures, summary.retried)
            reasons += [f"analysis {name}: {reason}" for name, reason in summary.analyses.items() if reason]
            raise InputError("; ".join(reasons) or "not all points were run")
        count = f"{summary.computed + summary.reused:,} points"
        return f"{count}; {summary.found}" if summary.found else count

    def _analyse(self, step: Step) -> str:
        name = step.analysis
        with self._cubes(self._inputs(step)) as cubes:
            result = ANALYSES[name].function(cubes, step.settings, self.workflow.folder)
            result = result.assign_attrs({"title": _title(name, cubes)} | result.attrs).load()
        cube = self.folder(step.name) / "cube.nc"
        write_dataset(stamp_history(result, f"tripod-doe workflow: {step.name}"), cube, listed=True)
        for path in self._exported(step):
            export = ANALYSES[name].export
            assert export is not None
            write_listed(path, export[1](result))
        return name

    def _exported(self, step: Step) -> list[Path]:
        """Files with the result of an analysis that answers the workflow's question, for other programs."""
        export = ANALYSES[step.analysis].export if isinstance(step.table, AnalysisStep) else None
        folder = self.directory / "quick" if self.workflow.quick else self.directory
        return [folder / export[0]] if export else []

    def _remove_exported(self, step: Step) -> None:
        for path in self._exported(step):
            path.unlink(missing_ok=True)

    def answers(self, views: tuple[StepView, ...]) -> AbstractContextManager[dict[str, xr.Dataset]]:
        """The existing cubes that answer the workflow's question, open within the block.

        Cubes of the exported analyses; if there are none, cubes of all analyses and studies.
        """
        steps = self.workflow.steps
        made = [view.name for view in views if view.state in ("finished", "reused")]
        answering = [name for name in made if isinstance(steps[name].table, AnalysisStep | StudyStep)]
        return self._cubes([name for name in answering if self._exported(steps[name])] or answering)

    def figures(self, views: tuple[StepView, ...]) -> dict[str, str]:
        """Headings of the figures on its report pages, by their addresses seen from the workflow's page."""
        steps = self.workflow.steps
        pages = {view.link: steps[view.name] for view in views if isinstance(steps[view.name].table, ReportStep)}
        return {
            f"{link}#{name}": table.title
            for link, page in pages.items()
            for name in page.inputs
            if link and isinstance(table := steps[name].table, FigureStep)
        }

    def _inputs(self, step: Step) -> list[str]:
        """The inputs of a step that have a cube."""
        pages = (FigureStep, ReportStep)
        return [name for name in step.inputs if not isinstance(self.workflow.steps[name].table, pages)]

    @contextmanager
    def _cubes(self, names: list[str]) -> Iterator[dict[str, xr.Dataset]]:
        """Cubes of some steps, open within the block.

        Raises:
            InputError: If another command changed one of them since its step, also at the end of the block: variables
                of a large cube are read within it.
        """
        with ExitStack() as opened:
            cubes = {name: opened.enter_context(opened_cube(self.folder(name))) for name in names}
            self._refuse_changed(names)
            yield cubes
            self._refuse_changed(names)

    def _refuse_changed(self, names: list[str]) -> None:
        for name in names:
            if self._digest(name) != self._made.get(name):
                raise InputError(
                    f"{self.folder(name)}: another command changed these results while the workflow ran; run the "
                    "workflow again"
                )

    def _draw(self, step: Step) -> str:
        assert isinstance(step.table, FigureStep)
        with self._cubes(self._inputs(step)) as cubes:
            charts = draw(step.table.figure, cubes)
        if not charts:
            raise InputError(f"the inputs hold nothing that the figure {step.table.figure} shows")
        write_charts(charts, step.name, self.folder(step.name))
        return f"{len(charts)} figure{'s' * (len(charts) > 1)}"

    def _report(self, step: Step) -> str:
        assert isinstance(step.table, ReportStep)
        steps = self.workflow.steps
        figures = {
            name: (table.title, self.folder(name))
            for name in step.inputs
            if isinstance(table := steps[name].table, FigureStep)
        }
        shown = [name for name in step.inputs if not isinstance(steps[name].table, ReportStep)]
        title = step.table.title or step.name
        question = self.workflow.file.workflow.question
        with self._cubes(self._inputs(step)) as cubes:
            page = step_page(title, question, shown, cubes, figures, _notice(self.workflow))
        write_listed(self.folder(step.name) / "index.html", page)
        return title


def _title(kind: str, inputs: Iterable[str]) -> str:
    """The title, in words, of an analysis without a given title."""
    return capital(f"{kind} of {', '.join(inputs)}".replace("_", " ").replace("-", " "))
