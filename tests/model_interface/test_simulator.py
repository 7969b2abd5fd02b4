"""What every simulator answers alike: declared outputs, defaults, what follows from what, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.model_interface import BlockResult, Dimension, Output, Parameter, Simulator, by_name
from tripod_doe.study.definition.function import FunctionSimulator
from tripod_doe.study.definition.simulators import SCENES, load_simulator

METHODS = {"plain": {"explicit": {"step_s": 1e-6}, "controlled": {"relative_tolerance": 1e-3}}, "fine": {"direct": {}}}


class Spring(Simulator):
    """A simulator of two models."""

    name = "spring"
    parameters = by_name(
        [
            Parameter("stiffness", 2.0, "N mm-1", "k", "stiffness", "assumed"),
            Parameter("other_stiffness", None, "N mm-1", "k", "the other one", "assumed", follows="stiffness"),
            Parameter("turns", 3, "1", "", "turns", "assumed", kind="integer"),
            Parameter("model", "plain", "1", "", "model", "numerics", kind="choice", choices=("plain", "fine")),
            Parameter(
                "method", None, "1", "", "m", "numerics", kind="choice", choices=("explicit", "controlled", "direct")
            ),
            Parameter("relative_tolerance", None, "1", "", "tolerance", "numerics"),
            Parameter("step_s", None, "s", "h", "step", "numerics"),
        ]
    )
    outputs = by_name(
        [
            Output("force", "N", "F", "force"),
            Output("path", "mm", "x", "path", (Dimension("turn", np.arange, "1", "turn", length_parameter="turns"),)),
        ]
    )

    def methods(self, values):
        return METHODS[values["model"]]

    def simulate(self, points, keep):
        return BlockResult.blank(len(points["turns"]))


SPRING = Spring()


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_is_a_simulator_that_declares_what_it_answers(scene):
    simulator = load_simulator(scene)
    assert isinstance(simulator, Simulator)
    assert simulator.name == scene
    full = simulator.effective({})
    assert set(full) == set(simulator.parameters)
    assert full["method"] in simulator.methods(full)
    assert all(
        full[parameter.follows] == full[name] for name, parameter in simulator.parameters.items() if parameter.follows
    )
    for output in simulator.outputs.values():
        assert output.shape(full) == tuple(simulator.labels([output.name], full)[dim].size for dim in output.dims)


def test_defaults_then_what_follows_then_the_numerics_of_the_method():
    assert SPRING.effective({"stiffness": 5.0}) == {
        "stiffness": 5.0,
        "other_stiffness": 5.0,
        "turns": 3,
        "model": "plain",
        "method": "explicit",
        "relative_tolerance": None,
        "step_s": 1e-6,
    }
    chosen = SPRING.effective({"other_stiffness": 1.0, "method": "controlled"})
    assert (chosen["other_stiffness"], chosen["step_s"], chosen["relative_tolerance"]) == (1.0, None, 1e-3)
    assert SPRING.effective({"model": "fine"})["method"] == "direct"


def test_columns_leave_open_what_is_unset():
    columns = SPRING.columns({"stiffness": 4.0}, {"turns": np.array([1, 2])}, 2)
    assert columns["stiffness"].tolist() == [4, 4]
    assert columns["turns"].tolist() == [1, 2]
    assert np.isnan(columns["other_stiffness"]).all()
    assert columns["method"].tolist() == [None, None]


def test_lengths_follow_the_parameter_that_sets_them():
    assert SPRING.outputs["path"].shape({"turns": 5}) == (5,)
    assert SPRING.labels(["force", "path"], {"turns": 2})["turn"].tolist() == [0, 1]
    with pytest.raises(InputError, match="turns takes 1 and 2, so path would have different lengths"):
        SPRING.check({}, {"turns": [1, 2]}, ["force", "path"])
    assert SPRING.check({}, {"turns": [1, 2]}, ["force"]) == []
    assert SPRING.check({}, {"turns": [2]}, ["path"]) == []


@pytest.mark.parametrize(
    ("base", "factors", "message"),
    [
        ({"step_s": 1e-3, "method": "controlled"}, {}, r"step_s = 0.001: not used by controlled \(plain\)"),
        ({"step_s": 1e-3, "model": "fine"}, {}, r"step_s = 0.001: not used by direct \(fine\); leave it out$"),
        ({"relative_tolerance": 0.1}, {}, "take a method that uses it: controlled"),
        ({"method": "direct"}, {}, "method = direct: not a method of plain; known: explicit, controlled"),
    ],
)
def test_numerics_that_nothing_in_play_uses_are_refused(base, factors, message):
    with pytest.raises(InputError, match=message):
        SPRING.check(base, factors, [])


@pytest.mark.parametrize(
    ("base", "factors"),
    [
        ({"step_s": 1e-3}, {}),
        ({"step_s": 1e-3}, {"method": ["controlled", "explicit"]}),
        ({"step_s": 1e-3}, {"model": ["fine", "plain"]}),
        ({"method": "direct"}, {"model": ["fine", "plain"]}),
    ],
)
def test_numerics_that_one_in_play_uses_are_allowed(base, factors):
    assert SPRING.check(base, factors, []) == []


def test_a_dimension_says_what_it_is_even_where_no_output_declares_it():
    assert SPRING.dimension_attributes("turn") == {"long_name": "turn", "units": "1"}
    assert SPRING.dimension_attributes("some_axis") == {"long_name": "some axis", "units": "1"}


def test_each_model_and_method_is_compiled_once(monkeypatch):
    compiled = []
    monkeypatch.setattr(Spring, "compile", lambda self, *solver: compiled.append(solver))
    monkeypatch.setattr(Spring, "name", "another spring")
    points = SPRING.columns(
        {},
        {
            "model": np.array(["plain", "fine", "plain", "plain"], object),
            "method": np.array([None, np.nan, "controlled", None], object),
        },
        4,
    )
    assert SPRING.solvers(points) == [
        ("plain", "explicit"),
        ("fine", "direct"),
        ("plain", "controlled"),
        ("plain", "explicit"),
    ]
    SPRING.prepare(points)
    SPRING.prepare(points)
    assert compiled == [("plain", "explicit"), ("fine", "direct"), ("plain", "controlled")]


def test_a_function_has_no_methods_whatever_its_arguments_are_called():
    function = FunctionSimulator("m:f", lambda model, method=1: {"y": model * method})
    points = function.columns({}, {"model": np.array([1, 2])}, 2)
    function.prepare(points)
    assert function.solvers(points) == []
    assert function.simulate(points, ()).outputs["y"].data.tolist() == [1, 2]
