"""Parameter studies and designs of experiments for the thrust force of tripod constant velocity joints.

>>> import tripod_doe as td
>>> td.simulate(joint_angle_deg=10)                      # one point
>>> td.run("studies/thrust_map.toml", out="results")     # a study, on two processes
>>> td.open_cube("results")                              # what it found, labelled
"""

from tripod_doe.analysis.sensitivity import morris_effects, sobol_indices
from tripod_doe.errors import CubeError, InputError, StorageError, TripodDoeError
from tripod_doe.quantities import Output, Parameter
from tripod_doe.report.findings import find
from tripod_doe.report.page import write_report
from tripod_doe.results import Outcome
from tripod_doe.study.cube import open_cube
from tripod_doe.study.definition import Study, load_study
from tripod_doe.study.plan import Plan, plan_study
from tripod_doe.study.query import query_cube as query
from tripod_doe.study.schema import study_schema
from tripod_doe.study.simulate import simulate
from tripod_doe.workflow.run import RunSummary
from tripod_doe.workflow.run import run_study as run

__all__ = [
    "CubeError",
    "InputError",
    "Outcome",
    "Output",
    "Parameter",
    "Plan",
    "RunSummary",
    "StorageError",
    "Study",
    "TripodDoeError",
    "find",
    "load_study",
    "morris_effects",
    "open_cube",
    "plan_study",
    "query",
    "run",
    "simulate",
    "sobol_indices",
    "study_schema",
    "write_report",
]
