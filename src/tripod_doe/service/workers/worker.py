"""The process of a worker: it receives questions and sends answers or refusals, one at a time.

A question names a function of the service (``workers.answers:plan``), or with a dot in front one of the package. Only
workers parse bodies of requests, so that no text can block the server.
"""

from __future__ import annotations

import errno
import json
import math
import os
import resource
import signal
import sys
import time
import traceback
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any

from tripod_doe.errors import InputError, StorageError, TripodDoeError
from tripod_doe.service.problems import Problem, RefusedError, refusal_of
from tripod_doe.service.requests.bodies import read_form
from tripod_doe.service.requests.uploads import STUDY
from tripod_doe.service.workers.forking import lead_group, limit_memory
from tripod_doe.study.result_directory.open_cube import NoResultsError

_LONGEST_TRACEBACK = 8_000
_OF_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)

Reply = tuple[str, Any]
"""``"answer"`` with the answer, ``"refused"`` with status and problems, ``"full"`` with the name that cannot be
written, or ``"failed"`` with text for the log."""


def serve(connection: Connection[Any, Any], memory_bytes: int) -> None:
    """Answer questions until the connection ends."""
    lead_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all processes of a terminal
    os.dup2(sys.stderr.fileno(), 1)  # output that functions print
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    limit_memory(memory_bytes)
    while True:
        try:
            place, seconds, arguments, as_json = connection.recv()
        except EOFError:
            return
        end = math.ceil(time.process_time() + seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (end, resource.RLIM_INFINITY))  # the system ends longer work
        connection.send(_reply(place, arguments, as_json))


def _reply(place: str, arguments: dict[str, Any], as_json: bool) -> Reply:
    try:
        module, _, name = place.partition(":")
        if fields := arguments.pop("fields", None):  # of a body: as arguments of their own
            arguments |= read_form(*fields).model_dump()
        answer = getattr(import_module(f".{module}", "tripod_doe.service"), name)(**arguments)
        return "answer", json.dumps(answer, allow_nan=False).encode() if as_json else answer
    except RefusedError as error:
        return _refused(error)
    except NoResultsError:  # its advice is for the command line
        return _refused(RefusedError(404, "nothing has finished here yet"))
    except InputError as error:
        return _refused(refusal_of(error, {STUDY: arguments["study"]} if "study" in arguments else {}))
    except (MemoryError, RecursionError) as error:
        what = "memory" if isinstance(error, MemoryError) else "depth"
        return "refused", (413, [Problem(message=f"the answer needs more {what} than is allowed here")])
    except StorageError as error:
        return "full", str(error)
    except TripodDoeError as error:
        return "failed", f"{place}: {error}"
    except OSError as error:
        if error.errno in _OF_DISK:
            return "full", f"{error.filename or 'temporary files'}: cannot write here: {error.strerror}"
        return "failed", f"{place}: {traceback.format_exc()[-_LONGEST_TRACEBACK:]}"
    except Exception:
        return "failed", f"{place}: {traceback.format_exc()[-_LONGEST_TRACEBACK:]}"


def _refused(error: RefusedError) -> Reply:
    return "refused", (error.status, error.problems)
