"""The stamp from a file against the formula of its face, its symmetry and the law of friction."""

import numpy as np

from contact import Status, SurfaceMesh


def test_a_stamp_from_a_file_is_turned(example, tmp_path):
    script = example("surface_mesh")
    arguments = ["--cells", "12", "--around", "180", "--steps", "4", "--output", str(tmp_path)]
    found = script.main(arguments)
    assert (tmp_path / "surface_mesh.png").stat().st_size > 10_000
    assert (tmp_path / "stamp.stl").exists()
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
