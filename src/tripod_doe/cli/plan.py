"""Count points, time and bytes of a study, a workflow, a fit or an optimisation before anything runs."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tripod_doe.cli.parser import DONE, Command, Parser, add_untrusted, whole_number
from tripod_doe.errors import InputError, option


def _add_arguments(parser: Parser, arguments: Sequence[str]) -> None:
    parser.add_argument(
        "file", metavar="FILE.toml", type=Path, help="file of a study, a workflow, a fit or an optimisation"
    )
    parser.add_argument("--no-timing", action="store_true", help="count points and bytes only, without timing")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help='result directory with models that a pilot chose (model = "auto"), or with a split, to show them',
    )
    parser.add_argument("--quick", action="store_true", help="for a workflow: plan the smaller studies of [quick]")
    parser.add_argument(
        "--workers", metavar="N", type=whole_number, default=2, help="worker processes to plan for (default 2)"
    )
    add_untrusted(parser)


def _run(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition.toml_text import tables_in

    tables = tables_in(options.file)
    kinds = {"study": _plan_study, "workflow": _plan_workflow, "fit": _plan_fit, "optimisation": _plan_optimisation}
    return next((plan for kind, plan in kinds.items() if kind in tables), _plan_study)(options)


def _plan_study(options: argparse.Namespace) -> int:
    from tripod_doe.study.definition.study_file import load_study
    from tripod_doe.study.definition.study_folder import StudyFolder
    from tripod_doe.study.plan import plan

    if options.quick:
        raise InputError(f"{option('quick')}: {options.file} is a study; only workflows have a [quick]")
    study = load_study(options.file, StudyFolder.of(options.file, options.untrusted))
    more = 0
    if study.file.analysis:
        from tripod_doe.workflow.analyses import check_analyses
        from tripod_doe.workflow.tolerance_confirmation import confirming_points

        check_analyses(study)
        more = confirming_points(study)
    price = replace(plan(study, timing=not options.no_timing), confirming=more)
    print(price.describe(max(options.workers, 1)))
    if study.auto_model:
        from tripod_doe.analyses.model_choice.study_choice import describe_choice

        print(describe_choice(study, options.out, timing=not options.no_timing))
    if study.file.design.kind == "multifidelity":
        from tripod_doe.analyses.multifidelity.study_split import describe_split

        for line in describe_split(study, options.out, timing=not options.no_timing):
            print(line)
    return DONE


def _plan_optimisation(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.optimise_plan import parts_text, plan_optimisation

    if options.quick:
        raise InputError(f"{option('quick')}: {options.file} is an optimisation; only workflows have a [quick]")
    parts = plan_optimisation(options.file, not options.no_timing, options.untrusted)
    print(parts_text(parts, max(options.workers, 1)))
    return DONE


def _plan_workflow(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.plan import plan_workflow

    if options.out:
        raise InputError(
            f"{option('out')}: {options.file} is a workflow, and only a study has models chosen by a pilot"
        )
    whole = plan_workflow(options.file, options.quick, not options.no_timing, options.untrusted)
    print(whole.describe(max(options.workers, 1)))
    return DONE


def _plan_fit(options: argparse.Namespace) -> int:
    from tripod_doe.workflow.fit_plan import plan_fit

    for name, given in (("out", options.out), ("quick", options.quick)):
        if given:
            raise InputError(f"{option(name)}: {options.file} is a fit, for which plan does not have this flag")
    print(plan_fit(options.file, not options.no_timing, options.untrusted).describe(max(options.workers, 1)))
    return DONE


COMMAND = Command(
    "estimate points, time and size of a study, workflow, fit or optimisation; writes nothing", _add_arguments, _run
)
