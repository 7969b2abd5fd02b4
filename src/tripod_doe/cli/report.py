"""Write the page of a result directory again, or export a part of it."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_selection
from tripod_doe.cli.view import add_against, moved_points
from tripod_doe.errors import InputError

_FILES = {
    "pdf": "summary.pdf",
    "html": "summary.html",
    "xlsx": "tables.xlsx",
    "figures": "figures",
    "what-if": "what_if.html",
}
_ENDINGS = {".pdf": "pdf", ".html": "html", ".xlsx": "xlsx"}


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument("directory", metavar="DIR", type=Path, help="result directory")
    parser.add_argument(
        "--format",
        choices=tuple(_FILES),
        help="what to export instead: one page for print or a browser (question, three sentences, one "
        "picture), all tables with their units as a workbook, each figure as SVG and PNG, or the what-if page of a "
        "surrogate",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="where to export it: a file whose ending sets --format, or a folder for figures (default: "
        "DIR/report/summary.pdf, summary.html, tables.xlsx, figures, what_if.html)",
    )
    parser.add_argument(
        "--motion",
        action="store_true",
        help="add the joint in motion to the report: one or two points, simulated again; about a megabyte each",
    )
    add_selection(parser, "with --motion: a value of a factor")
    add_against(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.reports.fit_report import write_fit_page
    from tripod_doe.reports.study_report import write_report
    from tripod_doe.study.result_directory.open_cube import FIT_FILE, open_cube

    named = _ENDINGS.get(options.output.suffix.lower()) if options.output else None
    form = options.format or named
    if options.output and (form is None or (named and named != {"what-if": "html"}.get(form, form))):
        ask = "end the name in .pdf, .html or .xlsx, or give --format" if form is None else f"but --format is {form}"
        raise InputError(f"--output {options.output}: {ask}")
    if not options.motion and (options.select or options.against):
        raise InputError("--select and --against choose what moves; give --motion, too")
    if form and options.motion:
        raise InputError(f"--motion: only the report itself shows a joint in motion, not --format {form}")
    if form:
        return _hand_on(options.directory, form, options.output)
    if (options.directory / FIT_FILE).is_file():
        if options.motion:
            raise InputError(f"{options.directory}: a fit has no points to move; give the directory of a study")
        print(write_fit_page(options.directory, open_cube(options.directory)))
    else:
        print(write_report(options.directory, motion=moved_points(options) if options.motion else ""))
    return DONE


def _hand_on(directory: Path, form: str, output: Path | None) -> int:
    """Write a part of a report, and print where it is."""
    from tripod_doe.files.atomic_files import refuse_links, replace_file
    from tripod_doe.files.checksum_list import write_listed
    from tripod_doe.reports.one_page import figures_of, one_page, what_if_alone
    from tripod_doe.reports.workbook import tables_of

    refuse_links(directory)
    if form == "figures":
        files = figures_of(directory)
    elif form == "xlsx":
        files = {"": tables_of(directory)}
    elif form == "what-if":
        files = {"": what_if_alone(directory).encode()}
    else:
        page = one_page(directory)
        files = {"": page.pdf() if form == "pdf" else page.html().encode()}
    place = output or directory / "report" / _FILES[form]
    try:
        for name, data in files.items():
            path = place / name if name else place
            if output is None:
                write_listed(path, data)
            else:
                with replace_file(path) as fresh:
                    fresh.write_bytes(data)
    except OSError as error:
        raise InputError(f"--output {place}: cannot write: {error.strerror}") from error
    print(place)
    return DONE


COMMAND = Command("write the report of a result directory again, or export a part of it", _add_arguments, _run)
