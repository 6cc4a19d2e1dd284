"""Arguments that `identify_velocity` refuses, by name."""

import numpy as np
import pytest
from truths import FIELD

from cip import (
    Grid,
    IdentifiedVelocity,
    InputError,
    NotConverged,
    NotSupported,
    Sensors,
    Solver,
    Velocity,
    identify_velocity,
)

GRID = Grid((0, 1), 40, periodic=True)
SPEED = Velocity.from_expression("a + b*sin(2*pi*x1)", parameters={"a": 1.0, "b": 0.1})
SOLVER = Solver(GRID, SPEED)
START = SOLVER.state(FIELD)
SEEN = START["u"]


class Wrong:
    """Observations with a wrong operator, by default of a wrong shape."""

    times = (0.1,)
    values = (np.zeros(3),)

    def __init__(self, *operators, **others):
        self.operators = operators or (np.zeros((3, 40)),)
        self.__dict__.update(others)


ROWS = np.eye(3, START.data.size)
SILENT = Sensors([0.2, 0.5, 0.7], [0.1], np.full((1, 3), np.nan), 0.1)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"solver": SPEED}, "solver: "),
        ({"solver": Solver(GRID, 1.0)}, "solver: its velocity has no parameters"),
        ({"start": SEEN}, "state: "),
        ({"data": {}}, "data: "),
        ({"data": SEEN}, "data: "),
        ({"data": {0.0: SEEN}}, "data: the first time is 0"),
        ({"data": {0.1: SEEN[:-1]}}, "data: snapshot at t = 0.1: "),
        ({"data": {0.1: np.where(SEEN > 0, np.nan, 1)}}, "data: snapshot at t = 0.1: NaN"),
        ({"data": {0.1: np.ma.array(SEEN, mask=True)}}, "data: every value is masked"),
        ({"data": {np.nan: SEEN}}, "data: "),
        ({"data": Wrong()}, "data: expected values of shape"),
        ({"data": Wrong([0.0, 1.0])}, r"data: expected values of shape .* and list"),
        ({"data": Wrong(np.nan * ROWS)}, "data: entries of the operators: NaN"),
        ({"data": Wrong(1j * ROWS)}, "data: entries of the operators: expected real values"),
        ({"data": Wrong(ROWS, values=None)}, "data: expected values and an operator"),
        ({"data": Wrong(ROWS, deviations=0.1)}, "data: expected deviations for each of 1 times"),
        ({"data": SILENT}, "data: every value is masked or missing"),
        ({"data": SILENT, "regularization": "H2"}, "data: every value is masked or missing"),
        ({"data": {0.2: SEEN, 0.1: SEEN}, "noise": [0.1, 0.2]}, "noise: with one for each time"),
        ({"data": Sensors([0.5], [0.1], [[0.1]], 0.1), "noise": 0.1}, "noise: the data have"),
        ({"noise": -1.0}, "noise: "),
        ({"noise": np.nan}, "noise: "),
        ({"noise": [0.1, 0.1]}, "noise: "),
        ({"dt": 0.0}, "dt: "),
        ({"bounds": (2.0, 1.0)}, "bounds: "),
        ({"bounds": (2.0, 3.0)}, "bounds: the first guess of 'a'"),
        ({"bounds": {"c": (0, 1)}}, "bounds: 'c' is no parameter"),
        ({"regularization": "L2"}, "regularization: "),
        ({"weight": 1.0}, "weight: there is no seminorm"),
        ({"weight": "gcv", "regularization": "H1"}, "weight: "),
        ({"weight": -1.0, "regularization": "H1"}, "weight: "),
        ({"max_runs": 0}, "max_runs: "),
        ({"max_runs": np.inf}, "max_runs: expected a positive number, got inf"),
        ({"start": SOLVER.state(2.0)}, "start: the data do not change"),
        (
            {
                "solver": Solver(GRID, Velocity.from_expression("a", parameters={"a": 1})),
                "regularization": "H1",
            },
            "regularization: ",
        ),
    ],
)
def test_bad_input(changed, message):
    arguments = {"solver": SOLVER, "start": START, "data": {0.1: SEEN}, "dt": 0.05} | changed
    with pytest.raises(InputError, match=message):
        identify_velocity(
            arguments.pop("solver"), arguments.pop("start"), arguments.pop("data"), **arguments
        )


def test_schemes_without_derivatives_are_refused():
    solver = Solver(GRID, SPEED, profile="cubic", limiter="clamp")
    with pytest.raises(NotSupported, match="limiter: "):
        identify_velocity(solver, solver.state(FIELD), {0.1: SEEN}, dt=0.05)


def test_too_few_runs_are_no_answer():
    data = {0.2: np.roll(SEEN, 10)}
    with pytest.raises(NotConverged, match="max_runs: "):
        identify_velocity(SOLVER, START, data, dt=0.05, noise=1e-3, max_runs=2)


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / "found.json").write_text('{"format": "identified velocity 1"}')
    with pytest.raises(InputError, match=r"path: .* is damaged, it has no 'at_bounds'"):
        IdentifiedVelocity.load(tmp_path / "found.json", SPEED)
