"""Parameter studies and designs of experiments for the thrust force of tripod constant velocity joints.

>>> import tripod_doe as td
>>> td.simulate(joint_angle_deg=10)                      # one point
>>> td.run("studies/thrust_map.toml", out="results")     # a study
>>> td.open_cube("results")                              # its results, labelled

Modules outside of the folders are used by all of them (errors, names, numbers as text); `client` calls a service, and
`notification` reports the end of a run. Public names are imported when they are first used, so that workers and short
commands load no plotting.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tripod_doe.analyses.comparison.comparison import compare
    from tripod_doe.analyses.comparison.model_point import model_point
    from tripod_doe.analyses.contribution.contribution import contribution_shares
    from tripod_doe.analyses.diff.diff import diff
    from tripod_doe.analyses.findings import find
    from tripod_doe.analyses.sensitivity.morris import morris_effects
    from tripod_doe.analyses.sensitivity.sobol import sobol_indices
    from tripod_doe.client import Service, ServiceRun, connect
    from tripod_doe.errors import CubeError, InputError, StorageError, TripodDoeError
    from tripod_doe.measurements.measurement import read_measurement
    from tripod_doe.model_interface import Outcome, Output, Parameter
    from tripod_doe.motion_page.page import view
    from tripod_doe.reports.study_report import write_report
    from tripod_doe.study.definition.json_schema import study_schema
    from tripod_doe.study.definition.study import Study
    from tripod_doe.study.definition.study_file import load_study
    from tripod_doe.study.plan import Plan, plan
    from tripod_doe.study.query.query import query
    from tripod_doe.study.result_directory.open_cube import open_cube
    from tripod_doe.study.simulate import simulate
    from tripod_doe.workflow.derive import derive
    from tripod_doe.workflow.fit import FitSummary, fit
    from tripod_doe.workflow.optimise import OptimisationSummary, optimise
    from tripod_doe.workflow.run_study import RunSummary, run
    from tripod_doe.workflow.run_workflow import WorkflowSummary, run_workflow
    from tripod_doe.workflow.workflow_file import workflow_schema

_HOME = {
    "CubeError": "errors",
    "InputError": "errors",
    "FitSummary": "workflow.fit",
    "OptimisationSummary": "workflow.optimise",
    "Outcome": "model_interface",
    "Output": "model_interface",
    "Parameter": "model_interface",
    "Plan": "study.plan",
    "RunSummary": "workflow.run_study",
    "Service": "client",
    "ServiceRun": "client",
    "StorageError": "errors",
    "Study": "study.definition.study",
    "TripodDoeError": "errors",
    "connect": "client",
    "compare": "analyses.comparison.comparison",
    "contribution_shares": "analyses.contribution.contribution",
    "diff": "analyses.diff.diff",
    "derive": "workflow.derive",
    "find": "analyses.findings",
    "fit": "workflow.fit",
    "load_study": "study.definition.study_file",
    "model_point": "analyses.comparison.model_point",
    "morris_effects": "analyses.sensitivity.morris",
    "open_cube": "study.result_directory.open_cube",
    "optimise": "workflow.optimise",
    "plan": "study.plan",
    "query": "study.query.query",
    "read_measurement": "measurements.measurement",
    "run": "workflow.run_study",
    "run_workflow": "workflow.run_workflow",
    "simulate": "study.simulate",
    "sobol_indices": "analyses.sensitivity.sobol",
    "study_schema": "study.definition.json_schema",
    "view": "motion_page.page",
    "WorkflowSummary": "workflow.run_workflow",
    "workflow_schema": "workflow.workflow_file",
    "write_report": "reports.study_report",
}

__all__ = [
    "CubeError",
    "FitSummary",
    "InputError",
    "OptimisationSummary",
    "Outcome",
    "Output",
    "Parameter",
    "Plan",
    "RunSummary",
    "Service",
    "ServiceRun",
    "StorageError",
    "Study",
    "TripodDoeError",
    "WorkflowSummary",
    "compare",
    "connect",
    "contribution_shares",
    "derive",
    "diff",
    "find",
    "fit",
    "load_study",
    "model_point",
    "morris_effects",
    "open_cube",
    "optimise",
    "plan",
    "query",
    "read_measurement",
    "run",
    "run_workflow",
    "simulate",
    "sobol_indices",
    "study_schema",
    "view",
    "workflow_schema",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("tripod-doe")
    if name not in _HOME:
        raise AttributeError(f"module 'tripod_doe' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"tripod_doe.{_HOME[name]}"), name)
    checked = importlib.import_module("tripod_doe.argument_types").with_checked_arguments
    return globals().setdefault(name, value if isinstance(value, type) else checked(value))


def __dir__() -> list[str]:
    return __all__
