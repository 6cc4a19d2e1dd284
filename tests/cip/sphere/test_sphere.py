"""Transport on the sphere: orders, poles, mass, long steps, against exact solutions."""

from functools import partial

import numpy as np
import pytest
from convergence import order
from globe import FORMS, rotation, turned

import cip
from cip import InputError, Sphere, SphereSolver, State

MEANS = ("csl2_spline", "csl4_spline")


def deformation(case, period=5.0):
    """The flows 1 to 4 of Nair and Lauritzen (2010); 3 is divergent."""

    def wind(lon, lat, t):
        wave = np.cos(np.pi * t / period)
        if case == 1:
            u, v = 2.4 * np.sin(lon / 2) ** 2 * np.sin(2 * lat), 1.2 * np.sin(lon) * np.cos(lat)
        elif case == 3:
            u = -(np.sin(lon / 2) ** 2) * np.sin(2 * lat) * np.cos(lat) ** 2
            v = 0.5 * np.sin(lon) * np.cos(lat) ** 3
        else:
            lon = lon - (2 * np.pi * t / period if case == 4 else 0.0)
            u, v = 2 * np.sin(lon) ** 2 * np.sin(2 * lat), 2 * np.sin(2 * lon) * np.cos(lat)
        mean = 2 * np.pi / period * np.cos(lat) if case == 4 else 0.0
        return wave * u + mean, wave * v

    return wind


def hills(centres):
    """Gaussian hills (Nair and Lauritzen 2010)."""

    def f(lon, lat):
        total = 0.0
        for a, b in centres:
            cosine = np.sin(b) * np.sin(lat) + np.cos(b) * np.cos(lat) * np.cos(lon - a)
            total = total + 0.95 * np.exp(-10.0 * (1.0 - cosine))
        return total

    return f


def bell(lon, lat):
    """A cosine bell of radius 1/3 at (3 pi / 2, 0) (Williamson et al. 1992)."""
    r = np.arccos(np.clip(np.cos(lat) * np.cos(lon - 1.5 * np.pi), -1.0, 1.0))
    return np.where(r < 1 / 3, 500.0 * (1.0 + np.cos(3 * np.pi * r)), 0.0)


CENTRES = {
    1: [(np.pi, np.pi / 3), (np.pi, -np.pi / 3)],
    2: [(5 * np.pi / 6, 0.0), (7 * np.pi / 6, 0.0)],
    3: [(3 * np.pi / 4, 0.0), (5 * np.pi / 4, 0.0)],
    4: [(5 * np.pi / 6, 0.0), (7 * np.pi / 6, 0.0)],
}


def solver_of(profile, wind, n=24, **more):
    return SphereSolver(Sphere(2 * n, n), wind, FORMS[profile], profile, **more)


def l2(state, exact):
    w, u = state.grid.weights, state[state.names[0]]
    return float(np.sqrt((w * (u - exact) ** 2).sum() / (w * exact**2).sum()))


@pytest.mark.parametrize("profile", FORMS)
@pytest.mark.parametrize("angle", [0.0, np.pi / 4, np.pi / 2])
def test_a_bell_comes_back_over_the_poles(profile, angle):
    """Williamson's test 1 at 5.6 degrees, in 36 steps; smooth fields have the errors below."""
    solver = solver_of(profile, rotation(angle), 32)
    start = solver.state({"bell": bell, "hill": hills([(1.5 * np.pi, 0.0)]), "one": 1.0})
    end = solver.run(start, 1.0, dt=1 / 36).final
    most = {"cubic_spline": 0.08, "csl2_spline": 0.08, "quintic_spline": 0.03, "csl4_spline": 0.03}
    assert l2(end.field("bell"), start.field("bell").data[0]) < most[profile]
    assert l2(end.field("hill"), start.field("hill").data[0]) < most[profile] / 8
    assert np.abs(end.field("one").data - 1.0).max() < 1e-7
    if profile in MEANS:
        for name, mass in start.mass.items():
            assert end.mass[name] == pytest.approx(mass, rel=1e-13)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", [1, 2, 3, 4])
@pytest.mark.parametrize("profile", ["csl4_spline", "quintic_spline"])
def test_hills_come_back_from_a_deformation(case, profile):
    solver = solver_of(profile, deformation(case), 32, foot_tolerance=1e-5)
    start = solver.state(hills(CENTRES[case]))
    end = solver.run(start, 5.0, dt=5 / 24).final
    assert l2(end, start.data[0]) < {1: 0.05, 2: 0.1, 3: 0.06, 4: 0.1}[case]
    if profile in MEANS:
        assert end.mass == pytest.approx(start.mass, rel=1e-13)


@pytest.mark.parametrize(("profile", "least", "most"), [
    ("cubic_spline", 3.0, 4.7), ("csl2_spline", 2.7, 4.5),
    ("quintic_spline", 4.7, 6.7), ("csl4_spline", 4.7, 6.7),
])  # fmt: skip
def test_orders(profile, least, most):
    """Over a pole, dt / h fixed, against the rotated hill; its centre passes the pole itself."""
    cells, errors = [16, 24, 36], []
    start = hills([(0.0, 1.2)])
    for n in cells:
        solver = solver_of(profile, rotation(np.pi / 2), n, foot_tolerance=1e-9)
        end = solver.run(solver.state(start), 0.2, dt=0.8 / n).final

        def exact(lon, lat):
            return start(*turned(lon, lat, np.pi / 2, 0.4 * np.pi))

        errors.append(l2(end, solver.state(exact).data[0]))
    assert least < order(cells, errors) < most


def test_a_divergent_flow_has_its_exact_density():
    """v = cos(lat) shifts asinh(tan(lat)) by t: p = p0 (cos(lat0) / cos(lat))^2, across a pole."""

    def exact(lon, lat, t):
        back = np.arctan(np.sinh(np.arcsinh(np.tan(lat)) - t))
        p = 1.0 + 0.5 * np.sin(back) + 0.3 * np.cos(back) * np.cos(lon)
        return p * (np.cos(back) / np.cos(lat)) ** 2

    cells, errors = [12, 18, 27], []
    for n in cells:
        solver = solver_of("csl4_spline", lambda lon, lat: (0 * lon, np.cos(lat)), n)
        start = solver.state(partial(exact, t=0.0))
        end = solver.run(start, 0.6, dt=1.2 / n).final
        assert end.mass == pytest.approx(start.mass, rel=1e-13)
        errors.append(l2(end, solver.state(partial(exact, t=0.6)).data[0]))
    assert errors[-1] < 1e-5
    assert order(cells, errors) > 4.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", FORMS)
def test_a_step_may_cross_a_third_of_the_sphere(profile):
    """In one step of 120 degrees over both poles the error is that of one interpolation."""
    solver = solver_of(profile, rotation(np.pi / 2), 36)
    start = hills([(0.0, 0.7)])
    end = solver.step(solver.state(start), 1 / 3)
    exact = solver.state(lambda lon, lat: start(*turned(lon, lat, np.pi / 2, 2 * np.pi / 3)))
    assert l2(end, exact.data[0]) < 1e-3
    again = solver.step(end, -1 / 3)
    assert l2(again, solver.state(start).data[0]) < 2e-3


@pytest.mark.parametrize("profile", FORMS)
def test_noise_does_not_grow_at_the_poles(profile):
    """Short steps over the poles, from a random field; without `resolved` its norm explodes."""
    solver = solver_of(profile, rotation(np.pi / 2), 16)
    start = solver.state(np.random.default_rng(1).standard_normal((32, 16)))
    end = solver.run(start, 1.0, dt=1 / 200).final
    w = start.grid.weights
    assert (w * end.data[0] ** 2).sum() < (w * start.data[0] ** 2).sum()
    assert np.abs(end.data).max() < 4.0


@pytest.mark.parametrize("profile", FORMS)
def test_radius_and_fields_change_nothing(profile):
    """A larger sphere with faster winds, and the same field beside another one."""
    form = FORMS[profile]
    small = SphereSolver(Sphere(24, 12), rotation(0.6), form, profile)
    large = SphereSolver(
        Sphere(24, 12, radius=6371.0), rotation(0.6, 2 * np.pi * 6371.0), form, profile
    )
    f = hills([(1.0, 0.5)])
    one = small.run(small.state(f), 0.3, dt=0.05).final
    other = large.run(large.state({"dust": f, "ash": lambda lon, lat: lat}), 0.3, dt=0.05).final
    np.testing.assert_allclose(other.field("dust").data, one.data, rtol=0, atol=1e-12)
    assert other.mass["dust"] == pytest.approx(one.mass * 6371.0**2, rel=1e-11)


def test_winds_in_cells_are_those_of_their_function():
    wind, sphere = rotation(1.0), Sphere(48, 24)
    f = hills([(0.0, 1.0)])
    made = [SphereSolver(sphere, v) for v in (wind, np.array(wind(*sphere.mesh())))]
    ends = [one.run(one.state(f), 0.4, dt=0.05).final["u"] for one in made]
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-5)
    assert made[1].steady
    assert made[0].steady


@pytest.mark.parametrize("form", ["transport", "advection"])
def test_bounds(form):
    """A column without a limiter goes below zero; with it not, and its mass stays."""
    ends = {}
    for limiter in (None, "bounds"):
        solver = SphereSolver(Sphere(48, 24), rotation(0.8), form, limiter=limiter, bounds=(0, 1))
        start = solver.state(lambda lon, lat: 1.0 * (np.cos(lat) * np.cos(lon - 1) > 0.8))
        ends[limiter] = solver.run(start, 0.5, dt=0.02).final
    assert ends[None].data.min() < -0.01
    assert ends["bounds"].data.min() >= 0.0
    assert ends["bounds"].data.max() <= 1.0 + 1e-15
    if form == "advection":
        assert ends["bounds"].mass == pytest.approx(start.mass, rel=1e-13)
        with pytest.raises(InputError, match="outside the bounds"):
            SphereSolver(start.grid, rotation(0.8), form, limiter="bounds", bounds=(2, 3)).step(
                start, 0.1
            )


@pytest.mark.parametrize("suffix", [".npz", ".nc"])
@pytest.mark.parametrize("profile", ["csl4_spline", "quintic_spline"])
def test_restarts_take_the_same_bits(tmp_path, suffix, profile):
    if suffix == ".nc":
        pytest.importorskip("xarray")
    make = partial(
        SphereSolver, Sphere(24, 12, radius=2.0), deformation(4), FORMS[profile], profile
    )
    start = make().state({"ash": hills(CENTRES[4]), "air": 1.0}, t=0.5)
    whole = make().run(start, 1.7, dt=0.2, snapshots=[1.1])
    again = State.load(whole[1].save(tmp_path / f"state{suffix}"))
    assert again.grid.radius == 2.0
    np.testing.assert_array_equal(make().run(again, 1.7, dt=0.2).final.data, whole.final.data)
    folder = tmp_path / "run"
    make().run(start, 1.7, dt=0.2, snapshots=[1.1], save=folder)
    (folder / "snapshot_00002.npz").unlink()
    resumed = make().run(start, 1.7, dt=0.2, snapshots=[1.1], save=folder, resume=True)
    np.testing.assert_array_equal(resumed.final.data, whole.final.data)
    loaded = cip.Trajectory.load(whole.save(tmp_path / f"run{suffix}")[0], make())
    np.testing.assert_array_equal(loaded.final.data, whole.final.data)
    with pytest.raises(InputError, match="another velocity"):
        SphereSolver(Sphere(24, 12, radius=2.0), deformation(2), FORMS[profile], profile).run(
            start, 1.7, dt=0.2, snapshots=[1.1], save=folder, resume=True
        )


@pytest.mark.parametrize("profile", ["csl4_spline", "quintic_spline"])
def test_what_a_run_gives(profile, tmp_path):
    """Samples between cells, sums, and pictures of the globe against closed forms."""
    solver = solver_of(profile, rotation(0.0), 24)

    def f(lon, lat):
        return 1.0 + np.cos(lat) * np.cos(lon) + np.sin(lat)

    run = solver.run(solver.state(f), 0.25, dt=0.05, snapshots=1)
    points = np.array([[0.3, 2.0, 5.0, 0.0], [0.1, -1.2, 1.5, np.pi / 2]])
    expected = f(points[0] - 0.5 * np.pi, points[1])
    np.testing.assert_allclose(run.sample(points), expected, atol=2e-5)
    found = run.diagnostics
    np.testing.assert_allclose(found.mass, 4 * np.pi, rtol=1e-5)
    np.testing.assert_allclose(found.l2, np.sqrt(4 * np.pi * (1 + 1 / 3 + 1 / 3)), rtol=3e-3)
    steps = solver.state(lambda lon, lat: 1.0 * (lat > 0))
    # A jump along the equator: its length.
    jump = solver.run(steps, 0.05, dt=0.05)[0:1]
    assert cip.Trajectory(jump, solver, 0.05).diagnostics.total_variation[0] == (
        pytest.approx(2 * np.pi)
    )
    mesh = run.to_pyvista()
    assert mesh.n_cells == 48 * 24
    assert mesh.area == pytest.approx(4 * np.pi, rel=5e-3)
    assert run.to_pyvista(None).n_blocks == 2
    east = mesh.cell_centers().points[np.argmax(mesh.cell_data[run.final.names[0]])]
    assert east[1] > 0.5  # the maximum, first at lon = 0, has gone a quarter of the circle
    ax = run.plot()
    assert ax.get_xlabel() == "longitude"
    run.animate(tmp_path / "run.gif")
    assert (tmp_path / "run.gif").stat().st_size > 0


def test_to_xarray_has_degrees():
    pytest.importorskip("xarray")
    solver = solver_of("csl4_spline", rotation(0.0), 8)
    found = solver.run(solver.state({"ash": 1.0}), 0.1, dt=0.1).to_xarray(units={"ash": "kg m-2"})
    assert found.lat.attrs == {"axis": "Y", "units": "degrees_north"}
    np.testing.assert_allclose(found.lon, np.arange(11.25, 360, 22.5))
    assert found.ash_mean.dims == ("t", "lon", "lat")
    assert found.ash_mean.attrs["units"] == "kg m-2"
    np.testing.assert_allclose(found.ash_mass, 4 * np.pi)


def test_callbacks_and_steady_paths():
    """A callback may change the field; paths of a steady wind are traced once."""
    calls = []

    def wind(lon, lat):
        calls.append(lon.size)
        return np.cos(lat), 0 * lat

    solver = SphereSolver(Sphere(16, 8), wind, "conservative")
    end = solver.run(
        solver.state(1.0), 1.0, dt=0.1,
        callback=lambda s: State(s.grid, s.profile, 2 * s.data, s.t) if s.t == 1.0 else None,
    ).final  # fmt: skip
    np.testing.assert_allclose(end["mean"], 2.0, rtol=1e-7)
    traced = len(calls)
    solver.step(end, 0.1)
    assert len(calls) == traced
