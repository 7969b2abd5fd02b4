"""A service in Python: `connect` gives an object with the verbs of this package, computed where the service runs.

It needs an address and a token only, and uses the standard library: `urllib` follows no redirection here and asks no
proxy for this machine, so that the token goes to the named server and nowhere else.
"""

from __future__ import annotations

import json
import secrets
import tempfile
import time
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from urllib.error import HTTPError, URLError
from urllib.parse import parse_qsl, quote, urlencode, urlsplit
from urllib.request import Request

import numpy as np

from tripod_doe.errors import CubeError, InputError, TripodDoeError, printable
from tripod_doe.files.csv_table import read_csv_table
from tripod_doe.http_opener import LOOPBACK, opener_for
from tripod_doe.model_interface import BlockResult, Outcome
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.toml_text import parse_toml, read_text, toml_text
from tripod_doe.study.result_directory.derived_responses import read_responses

if TYPE_CHECKING:
    import xarray as xr

    from tripod_doe.measurements.measurement import Measurement
    from tripod_doe.study.execution.task import Task

_API = "/api/v1"
_FILE_KEYS = ("study", "table", "file", "files", "measurement")  # whose values are names of files
_SECONDS = 120.0  # a simulated point may take that long
_PAUSE = 0.5  # seconds between two questions about a run
_TRIES = 5  # where the service is busy
_MOST_BYTES = {"application/json": 500_000_000}  # of an answer in memory
_MOST_FILE_BYTES, _MOST_REFUSAL_BYTES = 5_000_000_000, 1_000_000
_TEXTS, _COUNTS = ("id", "name", "state", "message"), ("total", "finished", "failed", "missing")  # of a run

StudyLike = Mapping[str, Any] | str | Path


def connect(url: str, token: str | None = None) -> Service:
    """Connect to a service that ``tripod-doe serve`` started.

    Args:
        url: Its address; the printed one holds the token, too.
        token: Its token, or a read-only one.

    Raises:
        InputError: If nothing answers there, or the token is wrong.

    Examples:
        >>> service = td.connect("http://127.0.0.1:8811", token="...")  # doctest: +SKIP
        >>> service.run("studies/thrust_map.toml").query("thrust_amplitude", ["order=3"])  # doctest: +SKIP
    """
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(f"url = {url.partition('?')[0]!r}: expected an address such as http://127.0.0.1:8811")
    words = dict(parse_qsl(parts.query))
    token = token or words.get("token") or words.get("share")
    if not token:
        raise InputError("token: missing; the server printed an address with it at its start")
    if parts.scheme == "http" and parts.hostname not in LOOPBACK:
        warnings.warn(
            f"{parts.hostname}: the token goes there unencrypted; use https or a tunnel to this machine", stacklevel=2
        )
    service = Service(f"{parts.scheme}://{parts.netloc}", token)
    service.runs(most=1)
    return service


class Service:
    """A service with the verbs of this package.

    Args:
        url: Scheme, host and port.
        token: What it asks for.
    """

    def __init__(self, url: str, token: str) -> None:
        self.url, self._token = url, token
        self._opener = opener_for(url)

    def __repr__(self) -> str:
        return f"<service at {self.url}>"

    def run(self, study: StudyLike, *, wait: bool = True, progress: bool = True) -> ServiceRun:
        """Submit a study, a workflow, a fit or an optimisation.

        Args:
            study: Its file, sent with the files next to it that it names, also by a pattern or in a table; or the
                tables of a study as a dict.
            wait: Whether to wait for its end.
            progress: Whether to show the progress meanwhile.
        """
        key = {"Idempotency-Key": secrets.token_urlsafe(16)}  # sent again, it is the same run
        run = ServiceRun(self, self.ask("POST", "/runs", submission(study), headers=key))
        return run.wait(progress=progress) if wait else run

    def plan(self, study: StudyLike, timing: bool = True) -> dict[str, Any]:
        """Count and price the points of a study or a workflow; nothing of it runs."""
        return self.ask("POST", "/plans", {**submission(study), "timing": timing})

    def simulate(self, scene: str = "joint", **parameters: Any) -> xr.Dataset:
        """Simulate one point there, or one for every combination of the values in arrays; see `tripod_doe.simulate`."""
        from tripod_doe.study.simulate import simulated_by

        return simulated_by(self._compute, scene, parameters)

    def _compute(self, task: Task) -> tuple[BlockResult, float, float]:
        """The points of a task, one request each; CPU and wall seconds."""
        simulator = load_simulator(task.scene)
        block, seconds = BlockResult.blank(task.count), np.zeros(2)
        for row in range(task.count):
            values = dict(task.base) | {
                name: column[row : row + 1].tolist()[0] for name, column in task.columns.items()
            }
            record = self.ask("POST", "/simulate", {"scene": task.scene, **values})
            block.end(row, Outcome[record["outcome"].upper()], record["outcome_detail"])
            for name in task.keep:
                if record.get(name) is not None:
                    block.put(name, simulator.outputs[name].dims, row, np.array(_floats(record[name]), float))
            own = simulator.effective(values)
            for name, value in record["parameters"].items():
                if isinstance(value, float) and own.get(name) != value:  # the run chose it
                    block.settle(name, row, value)
            cost = record["cost"]
            block.steps[row], block.force_evaluations[row] = cost["steps"], cost["force_evaluations"]
            seconds += cost["cpu_seconds"], cost["wall_seconds"]
        return block, float(seconds[0]), float(seconds[1])

    def runs(self, text: str = "", *, tag: Sequence[str] = (), most: int | None = None) -> list[ServiceRun]:
        """Runs, the newest first: all, or those whose name, question, note, tags or factors hold the words of a text.

        Args:
            most: How many at most; all if omitted, else up to one page.
        """
        page = {"page": 1} if most else {}
        records = self.ask("GET", "/runs", query={"text": text, "tag": list(tag), **page})
        if not isinstance(records, list):
            raise TripodDoeError(f"{self.url}: its answer is no list of runs")
        return [ServiceRun(self, record) for record in records[:most]]

    def find(self, name: str) -> ServiceRun:
        """The newest run with this id or name."""
        runs = self.runs()
        for run in runs:
            if name in (run.id, run.name):
                return run
        raise InputError(f"{self.url}: no run {name!r} among {len(runs):,}")

    def ask(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None = None,
        *,
        query: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        """Ask the interface below ``/api/v1``; the answer is read if it is JSON.

        Raises:
            InputError: If the request is refused, with the reasons, or nothing answers.
            TripodDoeError: If the service fails.
        """
        words = [(n, v) for n, v in (query or {}).items() if v not in (None, "", [], ())]
        address = f"{self.url}{_API}{path}" + (f"?{urlencode(words, doseq=True)}" if words else "")
        data = None if body is None else json.dumps(body, default=_plain).encode()
        request = Request(address, data, dict(headers or {}), method=method)
        if data is not None:
            request.add_header("Content-Type", "application/json")
        request.add_unredirected_header("Authorization", f"Bearer {self._token}")
        again = method == "GET" or headers is not None
        status, kind, answer = self._sent(request, _TRIES if again else 1)
        if status >= 300:  # no redirection is followed, and what it says is no answer
            raise _refused(status, answer, path)
        try:
            return json.loads(answer or b"null") if kind == "application/json" else answer
        except (ValueError, RecursionError) as error:
            raise TripodDoeError(f"{self.url}: its answer is not JSON") from error

    def _sent(self, request: Request, tries: int) -> tuple[int, str, bytes]:
        """Status, type and body of an answer, asked for again while the service is busy."""
        for left in reversed(range(tries)):
            try:
                with self._opener.open(request, timeout=_SECONDS) as answer:
                    kind = answer.headers.get_content_type()
                    return answer.status, kind, self._content(answer, _MOST_BYTES.get(kind, _MOST_FILE_BYTES))
            except HTTPError as error:
                with error:
                    if error.code != 503 or not left:
                        return error.code, error.headers.get_content_type(), error.read(_MOST_REFUSAL_BYTES)
            except (URLError, HTTPException, OSError) as error:
                reason = getattr(error, "reason", None) or error
                raise InputError(f"{self.url}: no answer ({reason}); is the server running?") from None
            time.sleep(_PAUSE)
        raise AssertionError

    def _content(self, answer: BinaryIO, most: int) -> bytes:
        content = answer.read(most + 1)
        if len(content) > most:
            raise TripodDoeError(f"{self.url}: an answer of more than {most:,} bytes, the limit for this file")
        return content


@dataclass
class ServiceRun:
    """A run of a service; its attributes are from the latest answer about it."""

    service: Service
    record: dict[str, Any]  # as the service describes it

    def __post_init__(self) -> None:
        self._take(self.record)

    @property
    def id(self) -> str:
        """Its id."""
        return self.record["id"]

    @property
    def name(self) -> str:
        """Its name."""
        return self.record["name"]

    @property
    def state(self) -> str:
        """What it does: queued, running, stopping, stopped, finished or failed."""
        return self.record["state"]

    @property
    def points(self) -> dict[str, int]:
        """Points by their state: total, finished, failed, missing."""
        return self.record["points"]

    def refresh(self) -> ServiceRun:
        """Ask for its state again."""
        return self._take(self._ask("GET", ""))

    def wait(self, *, progress: bool = True) -> ServiceRun:
        """Wait for its end; TripodDoeError if it fails."""
        from tripod_doe.workflow.progress import Progress

        with Progress(self.points["total"], progress) as shown:
            done = 0
            while True:
                now = self.points["total"] - self.points["missing"]
                if now > done:
                    shown.add(now - done)
                    done = now
                if self.state in ("finished", "stopped", "failed"):
                    break
                time.sleep(_PAUSE)
                self.refresh()
        if self.state == "failed":
            raise TripodDoeError(printable(f"{self.name}: {self.record['message']}"))
        return self

    def stop(self) -> ServiceRun:
        """Stop it; what is finished is kept."""
        return self._take(self._ask("POST", "/stop"))

    def resume(self) -> ServiceRun:
        """Run what is missing."""
        return self._take(self._ask("POST", "/resume"))

    def retry_failed(self) -> ServiceRun:
        """Run failed points again."""
        return self._take(self._ask("POST", "/retry-failed"))

    def extend(self, study: StudyLike, *, wait: bool = True, progress: bool = True) -> ServiceRun:
        """Run a study that grew on its results, and wait for its end, unless `wait` is false."""
        run = self._take(self._ask("POST", "/extend", submission(study)))
        return run.wait(progress=progress) if wait else run

    def derive(self, file: StudyLike | None = None, drop: Collection[str] = (), *, wait: bool = True) -> ServiceRun:
        """Add variables by formula to its results, or drop some; see `tripod_doe.derive`.

        Args:
            file: TOML file with tables ``[responses.NAME]``, or these tables as a dict.
            drop: Names of variables that are removed.
            wait: Whether to wait until the results are written again.
        """
        if isinstance(file, Mapping):
            tables = file.get("responses", file)
        else:
            tables = {} if file is None else read_responses(Path(file))
        run = self._take(self._ask("POST", "/derive", {"responses": tables, "drop": list(drop)}))
        return run.wait(progress=False) if wait else run

    def compare(
        self,
        measurement: Measurement | str | Path,
        select: Mapping[str, Any] | Sequence[str] = (),
        nearest: bool = False,
        **settings: Any,
    ) -> xr.Dataset:
        """Compare a measured thrust force with a point of its cube, which is fetched; the measurement stays here.

        Args:
            measurement: The measurement, or its file.
            select, nearest: The point, as for `query`.
            settings: As `tripod_doe.compare` takes them.
        """
        from tripod_doe.analyses.comparison.comparison import compare
        from tripod_doe.analyses.comparison.model_point import model_point

        return compare(measurement, model_point(self.open_cube(), _selection(select), nearest), **settings)

    def annotate(self, **changes: Any) -> ServiceRun:
        """Change its name, owner, tags or note."""
        return self._take(self._ask("PATCH", "", changes))

    def share(self, days: int = 14) -> str:
        """Make a link that opens this run for reading, and nothing else."""
        return self._ask("POST", f"/shares?days={days}")["address"]

    def delete(self) -> None:
        """Put it into the bin."""
        self._ask("DELETE", "")

    def restore(self) -> ServiceRun:
        """Take it out of the bin."""
        return self._take(self._ask("POST", "/restore"))

    def query(
        self,
        variable: str,
        select: Mapping[str, Any] | Sequence[str] = (),
        nearest: bool = False,
        where: str | None = None,
        step: str | None = None,
    ) -> xr.Dataset:
        """Choose cells of one variable; see `tripod_doe.query`. `step` names one of a workflow or a search.

        Cells that do not meet `where` are NaN; there is no ``selected``.
        """
        asked = {"variable": variable, "select": _selection(select), "where": where, "step": step, "format": "netcdf"}
        return _dataset(self._ask("GET", "/query", query=asked | ({"nearest": "true"} if nearest else {})))

    def open_cube(self, step: str | None = None) -> xr.Dataset:
        """Its cube with its costs, or a step's: of a search, the step ``points``; while it runs, the points so far."""
        asked = {"step": step}
        cube = _dataset(self._ask("GET", "/cube.nc", query=asked))
        if "outcome" in cube:  # else the result of an analysis
            with suppress(CubeError):  # a cube that was copied without them
                costs = _dataset(self._ask("GET", "/cost.nc", query=asked))
                if costs.sizes.items() <= cube.sizes.items():  # else the study has just grown
                    cube = cube.assign(costs.data_vars)
        return cube

    def analysis(self, name: str, step: str | None = None) -> xr.Dataset:
        """The result of one of its analyses; of a fit ``fit``, of an optimisation ``candidates`` and ``front``.

        Of a workflow: one of its analysis steps, or of the study of a step.
        """
        return _dataset(self._ask("GET", f"/analysis/{quote(name, safe='')}.nc", query={"step": step}))

    def diff(self, other: ServiceRun) -> dict[str, Any]:
        """What differs between two runs."""
        return self._ask("GET", f"/diff/{quote(other.id, safe='')}")

    def report(self) -> str:
        """Its report as HTML."""
        return self._ask("GET", "/report/").decode()

    def _ask(self, method: str, path: str, body: Mapping[str, Any] | None = None, **words: Any) -> Any:
        return self.service.ask(method, f"/runs/{quote(self.id, safe='')}{path}", body, **words)

    def _take(self, record: Any) -> ServiceRun:
        """Take what the service says; TripodDoeError if it describes no run."""
        points = record.get("points") if isinstance(record, dict) else None
        counts = [type(points.get(key)) for key in _COUNTS] if isinstance(points, dict) else []
        if {*counts} != {int} or not all(isinstance(record.get(key), str) for key in _TEXTS):
            raise TripodDoeError(f"{self.service.url}: its answer describes no run")
        self.record = record
        return self

    def __repr__(self) -> str:
        done = self.points["total"] - self.points["missing"]
        return f"<run {self.name!r}: {printable(self.state)}, {done:,} of {self.points['total']:,} points>"

    def _repr_html_(self) -> str:
        """The run as a notebook shows it."""
        total, missing = self.points["total"], self.points["missing"]
        return (
            f"<p><strong>{escape(self.name)}</strong> {escape(self.state)} "
            f'<progress value="{total - missing}" max="{total}" aria-label="points"></progress> '
            f"{total - missing:,} of {total:,} points, {self.points['failed']:,} failed</p>"
        )


def submission(study: StudyLike) -> dict[str, Any]:
    """A study, workflow, fit or optimisation as the service takes it: its text and the files that it names."""
    if isinstance(study, Mapping):
        return {"study": toml_text(study)}
    path = Path(study)
    text, files = read_text(path, "study file"), dict[str, str]()
    tables = parse_toml(text, str(path))
    _attach(tables, path.parent, files)
    kind = next((kind for kind in ("workflow", "fit", "optimisation") if kind in tables), "study")
    return {kind: text, "files": files}


def _attach(value: Any, folder: Path, files: dict[str, str], key: str = "") -> None:
    """Add the files of a folder that some tables name by plain names, and those that they name.

    A text under another key than those of files is no file's name: a question may be spelled as a key file is.
    """
    if isinstance(value, dict):
        for name, inner in value.items():
            _attach(inner, folder, files, name)
    elif isinstance(value, list):
        for inner in value:
            _attach(inner, folder, files, key)
    elif key in _FILE_KEYS and isinstance(value, str):
        pattern = Path(value).name == value and set(value) & set("*?[")
        for name in sorted(path.name for path in folder.glob(value)) if pattern else [value]:
            if name not in files and _is_plain(name, folder):
                files[name] = read_text(folder / name, "file")
                _attach(_named_in(folder / name, files[name], key), folder, files)


def _named_in(path: Path, text: str, key: str) -> dict[str, Any]:
    """What a file names itself: the tables of a TOML file, the column ``file`` of a table of records."""
    if path.suffix == ".toml":
        return parse_toml(text, path.name)
    header, rows = read_csv_table(path, path.name) if key == "table" else ([], {})
    return {"file": [row[header.index("file")] for row in rows.values()] if "file" in header else []}


def _is_plain(name: str, folder: Path) -> bool:
    """Whether a name is one of a file in the folder itself: not hidden, and no link, which may lead to any file."""
    place = folder / name
    return Path(name).name == name and not name.startswith(".") and place.is_file() and not place.is_symlink()


def _selection(select: Mapping[str, Any] | Sequence[str]) -> list[str]:
    return [f"{n}={_choice(v)}" for n, v in select.items()] if isinstance(select, Mapping) else list(select)


def _choice(value: Any) -> str:
    """A selection as a query has it: a value, a list or a range."""
    if isinstance(value, slice):
        return f"{'' if value.start is None else value.start}:{'' if value.stop is None else value.stop}"
    items = np.ravel(np.asarray(value, object)).tolist()
    return ",".join(str(item.item() if isinstance(item, np.generic) else item) for item in items)


def _plain(value: Any) -> Any:
    """A value of NumPy for JSON."""
    if not hasattr(value, "tolist"):
        raise InputError(f"{value!r}: expected a number, a text or a list, not a {type(value).__name__}")
    return value.tolist()


def _floats(value: Any) -> Any:
    """Numbers with NaN in place of None."""
    if isinstance(value, list):
        return [_floats(item) for item in value]
    return float("nan") if value is None else value


def _dataset(data: bytes) -> xr.Dataset:
    """A netCDF file that arrived, in memory."""
    from tripod_doe.study.result_directory.open_cube import open_cube

    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as folder:
        path = Path(folder) / "answer.nc"
        path.write_bytes(data)
        return open_cube(path)


def _refused(status: int, answer: bytes, path: str) -> TripodDoeError:
    """The error behind an answer."""
    try:
        problems = json.loads(answer)["errors"]
        text = "\n".join(": ".join(filter(None, [p.get("key"), p["message"]])) for p in problems)
    except (ValueError, KeyError, TypeError, AttributeError):
        text = f"{path}: the server answered {status}"
    kinds: Mapping[int, Callable[[str], TripodDoeError]] = {404: CubeError, 409: CubeError}
    text = printable(text)
    return TripodDoeError(text) if status >= 500 else kinds.get(status, InputError)(text)
