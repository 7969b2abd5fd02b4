"""The command line: one module of this package for each command.

Answers go to standard output; progress and messages go to standard error. Exit codes: 0 done, 1 internal error,
2 wrong call or input (nothing started), 3 done, but something failed that was not expected, 130 interrupted.
"""

import argparse
import errno
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Any, NoReturn

from tripod_doe.cli import (
    annotate,
    check,
    compare,
    completion,
    derive,
    diff,
    docs,
    fit,
    init,
    optimise,
    plan,
    query,
    report,
    run,
    schema,
    serve,
    simulate,
    view,
    workflow,
)
from tripod_doe.cli.parser import DONE, INTERNAL, SOME_FAILED, WRONG_INPUT, Parser
from tripod_doe.errors import InputError, TripodDoeError, speaking_of_options
from tripod_doe.process.interrupts import INTERRUPTED, check_interrupt, leave_interrupted, take_interrupts

COMMANDS = {
    "run": run.COMMAND,
    "plan": plan.COMMAND,
    "derive": derive.COMMAND,
    "report": report.COMMAND,
    "workflow": workflow.COMMAND,
    "optimise": optimise.COMMAND,
    "query": query.COMMAND,
    "simulate": simulate.COMMAND,
    "view": view.COMMAND,
    "compare": compare.COMMAND,
    "diff": diff.COMMAND,
    "fit": fit.COMMAND,
    "check": check.COMMAND,
    "annotate": annotate.COMMAND,
    "serve": serve.COMMAND,
    "init": init.COMMAND,
    "schema": schema.COMMAND,
    "docs": docs.COMMAND,
    "completion": completion.COMMAND,
}
"""All commands by name, in the order of the help."""

_WITH_POINTS = {"run", "workflow", "fit", "optimise"}
"""Commands that keep finished points when they are interrupted."""

_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
_NO_MEMORY = re.compile(
    "failed to map segment|annot allocate memory|find/load shared object"
)  # a library that could not be loaded


class _Version(argparse.Action):
    """Print the version, which is looked up only for this flag."""

    def __call__(self, *call: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"tripod-doe {version('tripod-doe')}")
        raise SystemExit(DONE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line of this process, or the given words; return the exit code."""
    with speaking_of_options():
        if arguments is not None:
            return _run_command([_dashes(word) for word in arguments])
        import tripod_doe.process.own_process  # noqa: F401

        take_interrupts()
        code = _run_command([_dashes(word) for word in sys.argv[1:]])
    leave_interrupted()
    return code


def _run_command(arguments: Sequence[str]) -> int:
    """Run a command; report errors on standard error, and return the exit code."""
    try:
        options, unknown = build_parser(arguments).parse_known_args(arguments)
        if unknown:
            options.parser.refuse(unknown[0])
        code = _ran(options)
        check_interrupt()
        sys.stdout.flush()
        return code
    except SystemExit as stop:
        return _code_after_flush(int(stop.code or 0))
    except InputError as error:
        print(f"tripod-doe: {error}", file=sys.stderr)
        return WRONG_INPUT
    except TripodDoeError as error:
        print(f"tripod-doe: {error}", file=sys.stderr)
        return INTERNAL
    except KeyboardInterrupt:
        kept = "; finished points are kept: run again to continue" if {*arguments[:1]} & _WITH_POINTS else ""
        shown = ", or report DIR to see them" if arguments[:1] == ["run"] else ""
        print(f"tripod-doe: interrupted{kept}{shown}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader has closed our output
        sys.stderr.close()
        return DONE
    except Exception as error:
        if str(error).startswith("NetCDF:"):  # a part of a large cube, read on first use
            damaged = f"a netCDF file of these results is damaged ({error}); tripod-doe check DIR names it"
            print(f"tripod-doe: {damaged}", file=sys.stderr)
            return WRONG_INPUT
        return _print_reason(error)


def _ran(options: argparse.Namespace) -> int:
    """Run the command of a call, and send the notification of its end if requested."""
    if options.command is serve.COMMAND.run or getattr(options, "notify", None) is None:
        return int(options.command(options))
    from tripod_doe.notification import Notifier
    from tripod_doe.workflow.steps_file import found_sentences

    notifier, code = Notifier.of(options.notify), INTERNAL
    state, message = "failed", ""
    try:
        code = int(options.command(options))
        state = "finished" if code in (DONE, SOME_FAILED) else "failed"
        failed = "points or steps failed that were not expected" if code == SOME_FAILED else ""
        message = "; ".join(filter(None, (failed, found_sentences(options.out))))
        return code
    except KeyboardInterrupt:
        state = "stopped"
        raise
    except Exception as error:
        message = str(error)
        raise
    finally:
        facts = {"state": state, "name": options.out.name, "message": message, "directory": str(options.out.absolute())}
        if trouble := notifier.tell(facts):
            print(f"tripod-doe: --notify: {trouble}", file=sys.stderr)


def _code_after_flush(code: int) -> int:
    """The exit code of a call for help, which argparse prints."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return _print_reason(error)
    return code


def _print_reason(error: Exception) -> int:
    """Print the reason of an error on standard error; return the exit code."""
    try:
        if reason := _reason(error):
            print(f"tripod-doe: {reason}", file=sys.stderr)
        else:
            traceback.print_exception(error)
            print("tripod-doe: internal error (please report it with the lines above)", file=sys.stderr)
    except OSError:  # standard error is also full
        pass
    _give_up_output()
    return INTERNAL


def _reason(error: Exception) -> str:
    """The fault of the machine behind an error; empty if the program is at fault."""
    if isinstance(error, MemoryError) or (isinstance(error, ImportError | OSError) and _NO_MEMORY.search(str(error))):
        return "there is not enough memory, or ulimit -v is too low; finished points are kept"
    if isinstance(error, OSError) and error.errno in _DISK:
        place = f"{error.filename}: " if error.filename else ""
        return f"{place}cannot write: {error.strerror}"
    return ""


def _give_up_output() -> None:
    """Drop unwritten standard output, which Python would try to write again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        with open(os.devnull, "w") as nothing:
            os.dup2(nothing.fileno(), sys.stdout.fileno())


def _dashes(word: str) -> str:
    """``--joint_angle_deg=5`` as ``--joint-angle-deg=5``; values keep their underscores."""
    if not word.startswith("--"):
        return word
    flag, equals, value = word.partition("=")
    return flag.replace("_", "-") + equals + value


def build_parser(arguments: Sequence[str]) -> Parser:
    """The parser of all commands; `arguments` names the scene whose parameters are flags of `simulate`."""
    root = Parser(prog="tripod-doe", description="Parameter studies for the thrust force of tripod joints.")
    root.add_argument("--version", action=_Version, nargs=0, help="print the version")
    parsers = root.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)
    for name, command in COMMANDS.items():
        own = parsers.add_parser(name, help=command.help, description=command.help)
        command.add_arguments(own, arguments)
        own.set_defaults(command=command.run, parser=own, build_parser=build_parser)
    return root
