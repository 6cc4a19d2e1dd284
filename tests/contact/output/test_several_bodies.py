"""Several bodies as VTK data: a block for each, and both faces of every contact surface."""

import numpy as np
import pytest
import pyvista
from pressed_pairs import PROBLEMS, pair, slit, stack
from two_blocks import block, turned

from contact import ContactProblem, ContactResult, LoadStepper
from contact.output.contact_runs import arc_length
from skfem_adini import ElementQuadAdini


def resultant(face, weights):
    """Force of the tractions of a face on its body, summed in the plane."""
    push = -np.asarray(face["pressure"])[:, None] * face["normal"] + face["shear"]
    return (weights[:, None] * push).sum(axis=0)[:2]


def in_plane(points):
    return np.asarray(points, dtype=float)[:, :2].T


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in ("slit", "stack")])
def test_blocks(name):
    """Names, displacements, and tractions whose sums are the forces that each body feels."""
    problem = PROBLEMS[name]()
    result = problem.solve()
    blocks = result.to_pyvista()
    called = [body.name or f"body {k}" for k, body in enumerate(problem.body.bodies)]
    assert blocks.keys() == [*called, "contact 0", "contact 0 opposite"]
    for k, key in enumerate(called):
        grid, own = blocks[key], result[k]
        assert grid.n_cells == own.body.mesh.nelements
        expected = own.sample(in_plane(grid.points))
        # Grid points on cell boundaries may be found in a neighbour: continuous to rounding.
        off = np.asarray(grid["displacement"])[:, :2].T - expected
        assert np.abs(off).max() < 1e-12 * np.abs(expected).max()
    weights, size = result.system.rows.weights, np.abs(result.resultant).max()
    for k, key in enumerate(("contact 0", "contact 0 opposite")):
        # Straight facets: the mean normal of a point is that of the face.
        off = resultant(blocks[key], weights) - result[k].resultant
        assert np.abs(off).max() < 1e-10 * size
    assert np.array_equal(blocks["contact 0"]["pressure"], result.pressure)


def test_opposite_face_lies_on_the_other_body():
    """Of blocks that are turned, and apart: moved by the gap the points reach the lower one."""
    angle, gap = 0.3, 0.05
    place = turned(angle)
    upper = block(ElementQuadAdini, np.linspace(0.2, 0.8, 5), [gap, 0.5, 1.0], place=place)
    lower = block(ElementQuadAdini, np.linspace(0, 1, 8), [-1.0, -0.5, 0.0], place=place)
    n = np.array([-np.sin(angle), np.cos(angle)])  # upwards
    upper.fix("top", "x", -(gap + 0.01) * n[0]).fix("top", "y", -(gap + 0.01) * n[1])
    lower.fix("bottom", "xy")
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.2).solve()
    blocks = result.to_pyvista()
    first, opposite = (in_plane(blocks[f"contact 0{of}"].points) for of in ("", " opposite"))
    # Heights over the lower body's upper side.
    np.testing.assert_allclose(n @ first, gap, rtol=1e-12)
    np.testing.assert_allclose(n @ opposite, 0.0, atol=1e-14)
    np.testing.assert_allclose(blocks["contact 0"]["normal"][:, :2].T, -n[:, None] + 0 * first)
    np.testing.assert_allclose(
        blocks["contact 0 opposite"]["normal"][:, :2].T, n[:, None] + 0 * first
    )


def test_every_pair_has_its_surface():
    """A rigid foundation has no face; each part of the tractions stands in its own block."""
    result = stack().solve()
    blocks = result.to_pyvista()
    faces = ["contact 0", "contact 0 opposite", "tie 1", "tie 1 opposite", "contact 2"]
    assert blocks.keys() == ["top block", "body 1", "low/block", *faces]
    for k in range(3):
        own = result.part == k
        grid = blocks["tie 1" if k == 1 else f"contact {k}"]
        assert np.array_equal(grid["pressure"], result.pressure[own])
        assert grid.n_lines == 1
        off = resultant(grid, result.system.rows.weights[own]) - result.resultants[k]
        assert np.abs(off).max() < 1e-10 * np.abs(result.resultants).max()


def test_one_body_that_touches_itself_stays_one_grid():
    result = slit().solve()
    assert isinstance(result.to_pyvista(), pyvista.UnstructuredGrid)
    assert result.boundary_to_pyvista().n_lines == 1


def test_arc_length_is_that_of_the_body_with_the_contact_points():
    """Each run is as long as the side of its body, and continues the one before."""
    result = stack().solve()
    s, run = arc_length(result)
    assert np.array_equal(run, result.part)
    for k in range(3):
        x = result.x[0, run == k]
        np.testing.assert_allclose(np.abs(s[run == k] - k - 0.5), np.abs(x - 0.5), atol=1e-12)
        assert np.all(np.diff(s[run == k]) > 0)


def test_saved_result_is_written_alike(tmp_path):
    result = stack().solve()
    loaded = ContactResult.load(result.save(tmp_path / "stack.npz")).to_pyvista()
    ours = result.to_pyvista()
    assert loaded.keys() == ours.keys()
    for found, expected in zip(loaded, ours, strict=True):
        assert found == expected


def test_series(tmp_path):
    """ParaView's list of steps, each a list of blocks, whose files are complete."""
    stepper = LoadStepper(pair()).load("top", (0.05, 0.0), np.sin, body="upper")
    history = stepper.run([0.5, 1.0])
    path = history.to_pvd(tmp_path / "run.pvd")
    reader = pyvista.get_reader(path)
    assert list(reader.time_values) == [0.5, 1.0]
    for t, result in zip([0.5, 1.0], history, strict=True):
        reader.set_active_time_value(t)
        (blocks,) = reader.read()
        assert blocks.keys() == ["upper", "lower", "contact 0", "contact 0 opposite"]
        for key, expected in zip(blocks.keys(), result.to_pyvista(), strict=True):
            assert np.array_equal(blocks[key].points, expected.points)
            for name in expected.point_data:
                assert np.array_equal(blocks[key].point_data[name], expected.point_data[name])
    boundary = pyvista.get_reader(tmp_path / "run_boundary.pvd")
    boundary.set_active_time_value(1.0)
    assert np.array_equal(boundary.read()[0]["pressure"], history[1].pressure)
    assert not [p.name for p in tmp_path.iterdir() if p.name.startswith("tmp")]


def test_list_of_blocks_appears_last(tmp_path, monkeypatch):
    """A disk that fills while a block is written leaves no list that names a missing file."""
    from skfem_adini.ground import vtk_files

    written, whole = [], vtk_files.write_grid

    def full(path, grid):
        if len(written) == 2:
            raise OSError("no space left")
        written.append(path)
        whole(path, grid)

    monkeypatch.setattr(vtk_files, "write_grid", full)
    with pytest.raises(OSError, match="no space"):
        vtk_files.write_blocks(tmp_path / "step.vtm", pair().solve().to_pyvista())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["step_0.vtu", "step_1.vtu"]
