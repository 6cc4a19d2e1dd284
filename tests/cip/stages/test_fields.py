"""Several fields on the same feet: each as if it were alone, by its own rules."""

import numpy as np
import pytest
from schemes import BOX, CLOSED, FAMILIES, RING, TORUS, TUBE, field_of, form_of, solver_of

from cip import InputError, LeftDomain, Solver, Source, State, Velocity

SCHEMES = [scheme for family in FAMILIES.values() for scheme in family]
LIMITED = [
    ("cubic", "clamp", "transport"), ("quintic", "clamp", "transport"),
    ("adini", "eno", "advection"), ("bicubic", "clamp", "transport"),
    ("csl2", "rational", "advection"), ("csl4", "bounds", "advection"),
]  # fmt: skip


def fields_of(grid):
    waves = "1.2 + sin(2*pi*x1)" if grid.periodic[0] else "1 + x1**2"
    return {"smoke": field_of(grid), "dust": waves, "ash": 0.3}


def check_alone(solver, alone, fields, dt=0.083, t_end=0.2):
    """A run of all fields has the bits of a run of each by the solver `alone` of its name."""
    run = solver.run(solver.state(fields), t_end, dt=dt)
    for name, field in fields.items():
        one = alone(name).run(alone(name).state(field), t_end, dt=dt)
        np.testing.assert_array_equal(run.final.field(name).data, one.final.data)
        assert run.final.mass[name] == one.final.mass
    return run


@pytest.mark.sampled(6)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: "-".join(scheme))
def test_each_as_if_alone(scheme):
    solver = solver_of(*scheme)
    check_alone(solver, lambda name: solver, fields_of(solver.grid))


@pytest.mark.parametrize("steady", [True, False])
@pytest.mark.parametrize("scheme", LIMITED, ids=lambda scheme: "-".join(scheme))
def test_limiters_act_per_field(scheme, steady):
    profile, limiter, form = scheme
    wind = ["1 + 0.3*sin(2*pi*x2)", "0.5" if steady else "0.5*cos(t)"]
    solver = Solver(TORUS, Velocity.from_expression(*wind), form, profile, limiter)
    jump = {"smoke": lambda x, y: np.where(x < 0.5, 1.0, 0.0) + 0 * y, "dust": "2 + sin(2*pi*x1)"}
    check_alone(solver, lambda name: solver, jump)


@pytest.mark.parametrize("store", [True, False])
@pytest.mark.parametrize(("grid", "profile"), [(BOX, "bicubic"), (TUBE, "csl2"), (CLOSED, "cubic")])
def test_rules_by_field(grid, profile, store):
    """Walls, sources, decay: those of a field are those of a solver for it alone."""
    means = profile == "csl2"
    wind = Velocity.from_expression(*["0.7 + 0.2*sin(3*t + x1)", "0.4 + 0.1*x1"][: grid.dim])
    rules = {
        "smoke": {"boundary": 0.0, "decay": 0.7},
        "dust": {
            "boundary": {"x-": 0.0, "y-": 0.0} if means else {"x-": "1 + sin(t)", "y-": 0.5},
            "source": Source.from_expression("q*exp(-9*x1**2)", {"q": 2.0}),
        },
        "ash": {"boundary": 0.0 if means else 2.0, "source": 1.0, "decay": "1 + x1"},
    }
    if grid.dim == 1 or grid.periodic[1]:
        rules["dust"]["boundary"].pop("y-")

    def solver(**more):
        return Solver(grid, wind, form_of(profile), profile, store_feet=store, **more)

    arguments = {
        key: {name: rule[key] for name, rule in rules.items() if key in rule}
        for key in ("boundary", "source", "decay")
    }
    several = solver(**arguments)
    fields = dict.fromkeys(rules, "0.2 + x1*(1 - x1)")
    check_alone(several, lambda name: solver(**rules[name]), fields)
    other = several.with_parameters(q=0.0)
    ended = other.run(other.state(fields), 0.2, dt=0.1).final
    assert ended.mass["dust"] < several.run(several.state(fields), 0.2, dt=0.1).final.mass["dust"]


def test_bounds_by_field():
    """The bounds of one field are not those of another; a field without bounds has none."""
    make = {"limiter": "bounds", "form": "advection", "profile": "csl4"}
    bounds = {"low": (0.0, 1.0), "high": (0.5, 2.0)}
    solver = Solver(RING, 1.0, bounds=bounds, **make)
    step = {
        "low": lambda x: np.where(x < 0.5, 1.0, 0.0),
        "high": lambda x: np.where(x < 0.5, 2, 0.5),
    }
    fields = step | {"free": lambda x: np.where(x < 0.5, 1.0, -1.0)}
    alone = {name: Solver(RING, 1.0, bounds=pair, **make) for name, pair in bounds.items()}
    plain = Solver(RING, 1.0, form="advection", profile="csl4")
    run = check_alone(solver, lambda name: alone.get(name, plain), fields, 0.013, 0.3)
    for name, (low, high) in bounds.items():
        assert low - 1e-13 <= run.final[name].min()
        assert run.final[name].max() <= high + 1e-13
    assert run.final["free"].min() < -1 - 1e-3
    solver.step(run.final, 0.01)
    with pytest.raises(InputError, match="outside the bounds"):
        solver.state(fields | {"high": 0.2})


def test_names_and_shapes():
    solver = Solver(TORUS, [1.0, 0.5], "advection", "csl4")
    state = solver.state({"smoke": 1.0, "dust": "2 + sin(2*pi*x2)"})
    assert state.data.shape == (2, 4, *TORUS.nodes)
    assert state.fields == ("smoke", "dust")
    assert state.names[4:] == ("dust", "dust_mean_x", "dust_mean_y", "dust_mean")
    np.testing.assert_array_equal(state["dust_mean"], state.field("dust")["mean"])
    np.testing.assert_allclose(list(state.mass.values()), [1.0, 2.0], rtol=1e-13)
    given = State.from_function(
        {"a": "x1", "b": "x1"}, CLOSED, derivatives={"b": {"u_x": lambda x: 0 * x}}
    )
    assert (given["a_x"] == 1).all()
    assert (given["b_x"] == 0).all()


def test_results_by_field(tmp_path):
    solver = Solver(TORUS, [1.0, 0.5])
    run = solver.run(solver.state(fields_of(TORUS)), 0.2, dt=0.1, snapshots=2)
    dust = run["dust"]
    point = [[0.3, 0.4], [0.2, 0.9]]
    np.testing.assert_array_equal(run.sample(point)["dust"], dust.sample(point))
    np.testing.assert_array_equal(run.diagnostics["dust"].l2, dust.diagnostics.l2)
    data, mesh = run.to_xarray(), run.to_pyvista()
    np.testing.assert_array_equal(data["dust_xy"][-1], run.final["dust_xy"])
    np.testing.assert_array_equal(data["ash_mass"], run["ash"].diagnostics.mass)
    np.testing.assert_array_equal(mesh["dust"], dust.to_pyvista()["u"])
    assert [axes.get_title() for axes in run.plot()] == [f"{n}, t = 0.2" for n in run.final.fields]
    run.animate(tmp_path / "run.gif")
    assert (tmp_path / "run.gif").stat().st_size > 1000


def test_a_callback_changes_fields():
    solver = Solver(RING, 1.0)
    start = solver.state({"smoke": "sin(2*pi*x1)", "dust": 1.0})

    def settled(state):
        data = state.data.copy()
        data[1] *= 0.5
        return State(state.grid, state.profile, data, state.t, state.fields)

    run = solver.run(start, 0.3, dt=0.1, callback=settled)
    np.testing.assert_allclose(run.final["dust"], 0.125, rtol=1e-14)
    np.testing.assert_array_equal(
        run["smoke"].final.data, solver.run(start, 0.3, dt=0.1)["smoke"].final.data
    )
    with pytest.raises(InputError, match="it returned the fields"):
        solver.run(
            start, 0.3, dt=0.1, callback=lambda s: State(s.grid, "cubic", s.data, s.t, ("a", "b"))
        )


def test_a_field_without_data_on_a_wall_is_named():
    solver = Solver(CLOSED, 1.0, boundary={"smoke": 0.0})
    with pytest.raises(LeftDomain, match=r"'x-'.*, for dust as for others"):
        solver.step(solver.state({"smoke": 1.0, "dust": 1.0}), 0.1)


def test_diffusion_and_time_back_are_of_all():
    solver = Solver(TORUS, [1.0, 0.5], diffusion=0.01, decay={"dust": 0.5})
    alone = {"smoke": Solver(TORUS, [1.0, 0.5], diffusion=0.01)}
    alone["dust"] = Solver(TORUS, [1.0, 0.5], diffusion=0.01, decay=0.5)
    fields = {"smoke": "sin(2*pi*x1)", "dust": "1 + cos(2*pi*x2)"}
    check_alone(solver, alone.get, fields)
    plain = Solver(TORUS, [1.0, 0.5])
    check_alone(plain, lambda name: plain, fields, dt=-0.083, t_end=-0.2)
