"""Examples that are quick: heat, layers, two bodies, the appendix on the GPU, pictures."""

import re
import sys

import numpy as np
import pytest
import pyvista
from example_scripts import EXAMPLES

from contact import Status, SurfaceMesh


@pytest.mark.turns(4)
def test_heat_control(run):
    files = ["heat_control.png", "heat_control.gif"]
    numbers = run("heat_control", "--modes", "5", "--subspaces", "20", "40", files=files)
    assert numbers["default"][1] < 1e-10
    for pi in ("printed", "symmetric"):
        coarse, fine = numbers[f"{pi} 20"], numbers[f"{pi} 40"]
        assert fine[1] < coarse[1]
        assert fine[2] == pytest.approx(-0.31234, abs=1e-4)
    assert numbers["symmetric 20"][1] < 0.7 * numbers["printed 20"][1]
    assert numbers["driven"] < 0.1 * numbers["free"]


@pytest.mark.turns(4)
def test_identify_friction(run):
    E, friction = run("identify_friction", files=["identify_friction.png"])
    assert (E, friction) == pytest.approx((2.0, 0.35), rel=0.02)


@pytest.mark.turns(4)
def test_punch_shape(run):
    flat, shaped = run("punch_shape", files=["punch_shape.png"])
    assert flat > 1.0  # as under the edges of a flat punch
    assert shaped < 1e-5


def test_heat_skfem(run):
    numbers = run("heat_skfem", "--refine", "1", files=["heat_skfem.png"])
    assert numbers["paid"] == pytest.approx(numbers["promised"], rel=5e-3)
    assert numbers["residual"] < 1e-10


@pytest.mark.turns(4)
def test_the_example_holds_and_writes_its_window(example, tmp_path):
    example("layered_block").main(tmp_path)
    grid = pyvista.read(tmp_path / "layered_block.vti")
    assert grid.point_data["von_mises"].min() >= 0
    assert grid.point_data["displacement"].shape == (grid.n_points, 3)
    assert (tmp_path / "layered_block.png").stat().st_size > 10_000


@pytest.mark.filterwarnings("ignore:the cells are not parallelograms")
def test_shrink_fit_has_the_pressure_of_lame(run):
    found = run("shrink_fit", files=["shrink_fit.png"])
    for name in ("Q1", "Q2", "Adini"):
        assert found.errors[name][-1] <= 1e-3
        assert 1.8 <= found.orders[name] <= 2.5
        result, *bodies = found.results[name]
        assert max(result.kkt.values()) <= 1e-10
        # The two meet on polygons, on which normals jump: each body's forces balance.
        for body in bodies:
            assert np.abs(result[body].balance()["residual"]).max() <= 1e-10


@pytest.mark.slow
def test_ties_keep_the_order_of_the_elements(run, example):
    found = run("tied_meshes", "--cells", "2", "4", "6", files=["tied_meshes.png"])
    limits = example("tied_meshes").LIMITS
    for (name, _), (of_field, of_gradient) in found.orders.items():
        low, lower = limits[name]
        assert of_field >= low
        assert of_gradient >= lower


@pytest.mark.slow
def test_two_cylinders_have_the_pressure_of_hertz(run):
    found = run("validation_two_cylinders", files=["validation_two_cylinders.png"])
    for name, lines in found.lines.items():
        middle = lines[1]  # 16 cells in the half-width
        assert middle.rms <= 1e-3
        assert abs(middle.peak) <= 5e-4
        assert found.orders[name] >= 1.7
        for line in lines[1:]:  # which start from the solution on fewer points
            coarse = [step.phase.startswith("coarse") for step in line.result.history]
            assert any(coarse)
            assert coarse.count(False) <= 8
    for pair in found.cgs1.values():
        assert abs(pair.a / 6.215 - 1) <= 0.01
        assert abs(pair.p / 3585 - 1) <= 0.01
        assert max(pair.result.kkt.values()) <= 1e-10


@pytest.fixture(scope="module")
def appendix(example):
    return example("gpu_appendix")


def test_qr_solution_is_that_of_lu(appendix):
    A, f = np.random.default_rng(1).standard_normal((2, 40, 40))
    x = np.linalg.solve(A, f[0])
    # Both are backward stable: they differ by the condition times rounding.
    limit = 100 * np.linalg.cond(A) * np.finfo(float).eps * np.linalg.norm(x)
    assert np.linalg.norm(appendix.solve_by_qr(A, f[0]) - x) < limit


@pytest.mark.parametrize("size", ["64", "1000"])
def test_the_host_path_says_so_and_fills_the_table(run, monkeypatch, size):
    monkeypatch.setitem(sys.modules, "cupy", None)
    arguments = ["--size", size, "--order", "30"]
    seconds = run("gpu_appendix", *arguments, says="NumPy on the host", files=["gpu_appendix.png"])
    assert set(seconds) == {"vector addition", "solve by QR", "copy, neighbours", "copy, strided"}
    assert all(value > 0 for value in seconds.values())


@pytest.mark.gpu
def test_the_device_path_checks_its_results(appendix, tmp_path):
    if not appendix.has_device():
        pytest.skip("no CuPy or no device: pip install 'skfem-adini[cuda13]'")
    seconds = appendix.main(["--size", "100000", "--order", "200", "--output", str(tmp_path)])
    assert {"to the device, pinned", "allocation, pool"} <= set(seconds)


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_script_names_a_picture_for_the_gallery(script):
    assert re.search(r'"\w+\.(png|gif)"', script.read_text())


@pytest.mark.parametrize("name", ["half_space", "heat_model"])
def test_picture_is_drawn_where_it_is_asked_for(run, name):
    run(name, files=[f"{name}.png"])


def test_a_brake_turns_its_work_into_heat(run, example):
    found, script = (
        run("hot_contact", "--steps", "8", files=["hot_contact.png"]),
        example("hot_contact"),
    )
    ways = script.FRICTION * script.OMEGA
    for one in found.results[1:]:
        heat, x = one.balance(), one.contact.x
        work = ways * (1 - one.time / script.END) * (one.contact.mu @ x[0])
        assert heat["friction"] == pytest.approx(work, rel=1e-3, abs=1e-6)  # r at the points
        assert heat["error"] < 1e-12
        assert one.contact.contact_force == pytest.approx(script.FORCE, rel=1e-9)
    halfway = found.results[4]
    hottest = halfway.contact.x[0, halfway.contact.pressure.argmax()]
    assert 0.13 < hottest < 0.148
    assert halfway.T.max() > found.results[-1].T.max() > 50.0


def test_a_stamp_from_a_file_is_turned(run):
    arguments = ["--cells", "12", "--around", "180", "--steps", "4"]
    found = run("surface_mesh", *arguments, files=["surface_mesh.png", "stamp.stl"])
    # Facets lie within the rounded rim by its sagitta, some 1/200 of the push.
    assert abs(found.push / found.by_formula - 1) < 0.01
    pressed = found.history.results[0]
    assert np.ptp(pressed.x[0]) > 5  # in mm: the unit of the file was taken to that of the block
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
        # Stamp and mesh look the same after half a turn: no net shear.
        assert np.abs(result.resultant[:2]).max() < 1e-3 * found.push
        forces = result.balance()
        left = forces["load"] + forces["support"] + forces["contact"]
        assert np.abs(left).max() < 1e-9 * found.push
    assert abs(found.torque[0]) < 1e-3 * found.limit[0]
    assert np.all(np.diff(found.torque) > 0)
    assert np.all(found.torque <= found.limit)
    status = found.history.results[-1].status
    assert np.sum(status == Status.SLIP) > np.sum(status == Status.STICK)


def test_finer_triangles_come_nearer_to_the_formula(example, tmp_path):
    script = example("surface_mesh")
    x = np.random.default_rng(0).uniform(-6.5, 6.5, (2, 2000))
    inside = np.hypot(*x) < 0.97 * script.rim(np.arctan2(x[1], x[0]))
    x = np.vstack((x[:, inside], np.zeros(inside.sum())))
    up = np.tile([[0.0], [0.0], [1.0]], x.shape[1])
    errors = []
    for around in (60, 120, 240):
        script.stamp_file(tmp_path / "stamp.stl", around)
        stamp = SurfaceMesh.from_file(tmp_path / "stamp.stl", scale=1e3)
        errors.append(np.median(np.abs(stamp(x, up) - script.face(x))))
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]
