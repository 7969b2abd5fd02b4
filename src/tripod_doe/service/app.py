"""The web application: the interface under ``/api/v1`` behind its guard."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from anyio.to_thread import current_default_thread_limiter
from fastapi import Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from tripod_doe.errors import InputError, StorageError
from tripod_doe.service.page import asset_files, help, run_pages, study_editor
from tripod_doe.service.page.error_pages import refusal_answer
from tripod_doe.service.problems import RefusedError, form_problem, refusal_of
from tripod_doe.service.routes import reports, results, runs, share_links, studies, views
from tripod_doe.service.routes.dependencies import refuse_unread
from tripod_doe.service.security.guard import API, Guard
from tripod_doe.service.security.sessions import Sessions
from tripod_doe.service.security.tokens import Accesses
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers.worker_pool import WorkerFailedError

log = logging.getLogger(__name__)

_MOST_PROBLEMS = 20


def create_app(settings: Settings) -> FastAPI:
    """The application of a server.

    Returns:
        ``app.state.service`` is its `Service`, which starts and ends with it.

    Raises:
        InputError: If the folder cannot be used.
    """
    service, sessions = Service(settings), Sessions()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service.runs.events.attach(asyncio.get_running_loop())
        current_default_thread_limiter().total_tokens = service.threads
        app.openapi()  # 0.3 s, which all others would wait for in a request, as `refuse_unread` looks into it
        service.start()
        yield
        sessions.close()
        await asyncio.to_thread(service.close)

    app = FastAPI(
        title="tripod-doe",
        version=version("tripod-doe"),
        description="Parameter studies for the thrust force of tripod joints.",
        openapi_url=f"{API}/openapi.json",
        docs_url=None,  # FastAPI's pages load scripts from other servers
        redoc_url=None,
        lifespan=lifespan,
        root_path_in_servers=False,  # it belongs to the page
    )
    app.state.service, app.state.sessions = service, sessions
    for module in (runs, studies, results, reports, views, share_links):  # the most frequent requests come first
        app.include_router(module.router, prefix=API, dependencies=[Depends(refuse_unread)])
    for part in (asset_files, help, run_pages, study_editor):
        app.include_router(part.router)
    accesses = Accesses(settings, service.shares)
    app.add_middleware(Guard, settings=settings, accesses=accesses, sessions=sessions, refusal_answer=refusal_answer)
    _add_error_answers(app)
    return app


def _add_error_answers(app: FastAPI) -> None:
    """Every error is a list of problems, never a traceback."""

    def answer(request: Request, refusal: RefusedError) -> Response:
        access = request.scope.get("access")
        settings = access.settings if access else request.app.state.service.settings
        return refusal_answer(request, refusal.among_runs(settings.folder), settings, request.scope["root_path"])

    async def refused(request: Request, error: Exception) -> Response:
        return answer(request, _refusal(error))

    async def failed(request: Request, error: Exception) -> Response:
        known = error if not isinstance(error, WorkerFailedError) else None
        log.error("%s %s: %s", request.method, request.url.path, error, exc_info=known)
        return answer(request, RefusedError(500, "internal error; see the standard error of the server"))

    for kind in (RefusedError, InputError, RequestValidationError, HTTPException, StorageError):
        app.add_exception_handler(kind, refused)
    app.add_exception_handler(WorkerFailedError, failed)
    app.add_exception_handler(Exception, failed)


def _refusal(error: Exception) -> RefusedError:
    """An error of a caller, or of a server that cannot answer now, as the refusal that its answer states."""
    match error:
        case RefusedError():
            return error
        case InputError():
            return refusal_of(error, {})
        case RequestValidationError():
            return RefusedError(422, *(form_problem(item) for item in error.errors()[:_MOST_PROBLEMS]))
        case HTTPException():
            return RefusedError(error.status_code, str(error.detail), headers=dict(error.headers or {}))
    return RefusedError(503, str(error))
