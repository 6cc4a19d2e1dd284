"""A block, a part, ironing, a lap joint, a rough surface: numbers, proofs, statics and files."""

import matplotlib.image
import numpy as np
import pytest
import pyvista

from contact import InputError, Status


def test_the_block_its_proof_and_its_files(run, tmp_path):
    result, check = run("contact_block", files=["contact_block.vtu", "contact_block.png"])
    # Converged values on 10 x 10 cells; OSQP agrees with them to 1e-13 (below).
    assert result.contact_force == pytest.approx(0.1186442, abs=1e-7)
    assert result.u[1::6].min() == pytest.approx(-0.311533, abs=1e-6)
    assert np.abs(result.u[::6]).max() == pytest.approx(0.073175, abs=1e-6)
    assert result.pressure.max() == pytest.approx(0.221212, abs=1e-6)
    np.testing.assert_allclose(result.zone[0], [1 / 6, 5 / 6], rtol=1e-12)
    assert max(result.kkt.values()) < 1e-12
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert result.mu.min() >= 0
    assert check.displacement < 1e-7  # OSQP, polished
    grid = pyvista.read(tmp_path / "new/contact_block.vtu")
    assert set(grid.celltypes) == {pyvista.CellType.LAGRANGE_QUADRILATERAL}
    points = np.random.default_rng(0).uniform(0.02, 0.98, (40, 2))
    cloud = pyvista.PolyData(np.column_stack((points, np.zeros(40))))
    sampled = np.asarray(cloud.sample(grid, tolerance=1e-12)["displacement"])[:, :2]
    np.testing.assert_allclose(sampled, result.sample(points.T).T, atol=1e-12)
    assert {"von_mises", "stress_yy"} <= set(grid.cell_data)
    image = matplotlib.image.imread(tmp_path / "new/contact_block.png")
    assert image.shape[0] > 1000
    assert image[..., :3].std() > 0.1  # not blank


@pytest.mark.slow
def test_a_real_part_from_a_mesh_file(example, tmp_path):
    main = example("contact_part").main
    result, check = main(["--output", str(tmp_path)])
    # Regression values of the default mesh; the proof below says that they solve the problem.
    np.testing.assert_allclose(result.resultant, [-0.2958, 2.0266], atol=2e-3)
    assert result.pressure.max() == pytest.approx(0.613, abs=0.006)
    counts = np.bincount(result.status, minlength=3)
    # On a curve a contact point is a vertex: 15 of them touch.
    assert counts[Status.STICK] >= 8
    assert counts[Status.SLIP] >= 4
    assert max(result.kkt.values()) < 1e-10
    assert check.displacement < 1e-7
    # The mount takes the load: reaction and contact force cancel.
    assert np.abs(result.balance()["residual"]).max() < 1e-10
    grid = pyvista.read(tmp_path / "contact_part.vtu")
    assert grid.n_cells == result.system.body.mesh.nelements
    assert (tmp_path / "contact_part.png").stat().st_size > 50_000
    mesh = tmp_path / "bumper.msh"
    again, _ = main(["--mesh", str(mesh), "--output", str(tmp_path / "again"), "--no-picture"])
    np.testing.assert_allclose(again.resultant, result.resultant, rtol=1e-10)
    mesh.write_text(mesh.read_text()[: mesh.stat().st_size // 3])
    with pytest.raises(InputError, match="cannot be read"):
        main(["--mesh", str(mesh), "--output", str(tmp_path)])


# The script runs in every CI run by itself; what it finds is checked in the slow lane.


@pytest.mark.slow
def test_rubber(run):
    found = run("rubber", "--cells", "4", files=["rubber.png"])
    assert abs(found.forces[0.0] - found.exact) <= 1e-8 * found.exact
    assert found.forces[0.4] > 1.1 * found.exact  # friction resists bulging


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "cells"), [(0.2, 18), (0.0, 36)])
def test_hardness(run, friction, cells):
    """Once all of it flows, three yield stresses (D. Tabor, The Hardness of Metals, 1951); without
    friction 2.84 (1 - exp(-.82 (R / a)^.7)), 2.76 to 2.78 here, for a ball that yields on a plate
    (R. L. Jackson and I. Green, J. Tribol. 127 (2005), 343-354)."""
    options = ("--friction", str(friction), "--cells", str(cells))
    found = run("hardness", *options, files=["hardness.png"])
    flows = found.a > (0.075 if friction else 0.11)  # E a / (Y R) above 75
    assert flows.sum() >= (4 if friction else 2)
    assert found.hardness[flows].min() >= (2.8 if friction else 2.75)
    assert found.hardness[flows].max() <= (3.1 if friction else 2.84)
    assert np.all(np.diff(found.a) > 0)


@pytest.mark.slow
def test_press_fit(run):
    """First order in the size of cells, from above: the pressure hot, and the one that is left."""
    errors = []
    for cells in (6, 12):
        found = run("press_fit", "--cells", str(cells), files=["press_fit.png"])
        errors.append((found.pressure[4] / found.peak - 1, found.pressure[-1] / found.left - 1))
    assert 0 < max(errors[1]) <= 2e-3
    assert np.all(np.array(errors[1]) <= 0.5 * np.array(errors[0]))


def test_ironing(run, example):
    """Full slip to and fro, and energy that balances up to the rule for integrals."""
    script = example("ironing")
    found = run("ironing", "--cells", "9", "--steps", "8", files=["ironing.png"])
    times = found.history.times
    for t, result in zip(times, found.history.results, strict=True):
        assert max(result.kkt.values()) <= 1e-10
        assert sum(line.phase == "projection" for line in result.history) <= 6
        if 1.2 < t < 2.0 or t > 2.3:
            limit = (1.0 if t < 2.0 else -1.0) * script.FRICTION * result.mu.sum()
            assert abs(result.t.sum() - limit) <= 1e-10 * abs(limit)
    sliding = found.forces[(times > 1.2) & (times < 1.9), 1]
    assert np.ptp(sliding) <= 0.02 * sliding.mean()
    coarse = script.ironed(9, 4)
    off = [
        abs(work[-1] - stored[-1] - lost[-1]) / work[-1]
        for work, stored, lost in (
            script.energies(coarse[0], coarse[1]),
            (found.work, found.stored, found.lost),
        )
    ]
    assert off[1] <= 0.02
    assert off[1] < off[0]


@pytest.mark.slow
def test_impact(run, example):
    """The ledger closes; momentum is what the floor gives, spin what its friction does."""
    history = run("contact_impact", files=["contact_impact.png"]).history
    assert np.abs(history.residual).max() <= 1e-10 * history.total[0]
    lost = history.friction.sum() + history.impact.sum()
    assert history.total[0] - history.total[-1] == pytest.approx(lost, rel=1e-9)
    assert history.friction.sum() > 0
    x = history[-1].result.body.basis.doflocs
    last, impulse = history[-1].v, history.dt * history.force.sum(axis=0)
    values = np.arange(last.size) % 2
    spin = np.polyfit(x[0, values == 1], last[values == 1], 1)[0]
    assert spin < 0 < impulse[1]
    assert -0.25 * impulse[1] <= impulse[0] < 0  # the normals of the rim lean


@pytest.mark.slow
def test_lap_joint(run, example):
    script = example("lap_joint")
    found = run("lap_joint", "--cells", "3", "--steps", "4", files=["lap_joint.png"])
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
    last, early = found.history.results[-1], found.history.results[1]
    for body in found.bodies.values():
        assert np.abs(last[body].balance()["residual"]).max() <= 1e-10
    # The support of the lower plate holds what the upper one is pulled by, through both ways.
    support = -2 * last["lower"].balance()["support"][0]
    assert abs(support - (found.plates + found.shank)[-1]) <= 1e-9 * support
    # Both heads press alike, and the plates on each other by as much.
    press = [last.mu[last.part == k].sum() for k in range(3)]
    np.testing.assert_allclose(press, press[0], rtol=0.1)
    # Friction between the plates has a limit.
    between = last.part == 0
    limit = 2 * script.FRICTION * last.mu[between].sum()
    assert 0.8 * limit <= found.plates[-1] <= limit * (1 + 1e-9)
    assert not np.any(last.status[between] == Status.STICK)
    assert np.any(early.status[early.part == 0] == Status.STICK)
    assert np.all(np.diff(found.plates + found.shank) > 0)
    assert found.shank[-1] > 0.05 * found.plates[-1]


@pytest.mark.slow
def test_rough_surface(run, example, tmp_path):
    """Half spaces lie between the asymptotes of the theories, the block between half spaces."""
    pyvista, script = pytest.importorskip("pyvista"), example("rough_surface")
    rough = run("rough_surface", "--points", "96", "--steps", "5", files=["rough_surface.png"])
    results = [r for loads in rough.loads.values() for r in loads]
    assert max(max(r.kkt.values()) for r in results + rough.drags) < 1e-10
    areas = rough.areas
    light, few = areas["coating"] / script.PRESSURES, areas["coating"] < 0.1
    assert np.count_nonzero(few) >= 3
    assert np.all(light[few] > np.sqrt(8 / np.pi))
    assert np.all(light[few] < np.sqrt(2 * np.pi))
    assert np.all(areas["coating"] > rough.persson)
    assert np.all(areas["coated block"] > areas["coating"])
    assert np.all(areas["coated block"] < areas["substrate"])
    # The force grows to F P while what sticks shrinks.
    assert np.all(np.diff(rough.share) > 0)
    assert 0.98 < rough.share[-1] <= 1 + 1e-9
    assert np.all(np.diff(rough.stuck[1:]) <= 0)
    assert rough.stuck[1] > 0.1
    assert rough.stuck[-1] < 0.02
    assert pyvista.read(tmp_path / "new/rough_surface.vti").dimensions == (96, 96, 1)
    image, (points, stress) = pyvista.read(tmp_path / "new/rough_surface_section.vti"), rough.inside
    at = image.find_closest_point(points[:, 7, 11])
    assert image.points[at] == pytest.approx(points[:, 7, 11], abs=1e-6)
    assert image["von Mises"][at] == pytest.approx(stress[7, 11])
    assert stress.max() < 2 * rough.loads["coated block"][-1].pressure.max()


def test_adhesion(run):
    results, force = run("adhesion", says="pull-off", files=["adhesion.png"])
    assert min(force) == pytest.approx(-1.6007, rel=0.01)  # Maugis' closed form
    assert [r.jump for r in results if r.jump] == ["contact", "pull-off"]


@pytest.mark.turns(3)
def test_hard_surface(run):
    steps = run("hard_surface", says="share in contact", files=["hard_surface.png"])
    assert np.ptp(steps[-1].indentation - steps[6].indentation) < 1e-12
    assert 0.7 < steps[6].area < 0.74


def test_wear_pin(run):
    history = run("wear_pin", says="0.004000000 worn", files=["wear_pin.png"])
    assert history.results[-1].worn_volume[0] == pytest.approx(4e-3, rel=1e-10)
    assert history.results[-1].pressure.max() < 0.6 * history.results[0].pressure.max()
