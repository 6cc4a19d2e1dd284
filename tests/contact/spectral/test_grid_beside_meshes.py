"""Contact on a grid beside that of the sparse body, the dense solvers, and any certificate."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from contact import (
    ContactProblem,
    Cylinder,
    GridContact,
    Infeasible,
    InputError,
    LoadStepper,
    PeriodicLayers,
    Plane,
    Rigid,
    Sphere,
    Status,
)
from contact.spectral.grid_result import certified
from skfem_adini import ElementHexAdini, ElementQuadAdini

COATED = [(0.1, 2, 3.0, 0.2), (0.4, 4, 1.0, 0.3)]
F = 0.3
BOX = (1.0, 1.25)
PLANE_ADINI, SPACE_ADINI = {"element": ElementQuadAdini()}, {"element": ElementHexAdini()}
ROLLERS, IN_A_BOX = {"sides": "x"}, {"sides": ("x", "y")}


def flat(*motion):
    dim = len(motion)
    return Rigid(Plane(np.zeros(dim), np.eye(dim)[-1]), displacement=motion)


# Length, cells and settings of the layers, and the obstacle. Where the mesh ties the ends of the
# surface to each other, the obstacle touches between them.
CASES = {
    "plane": (1.0, 16, {"motion": (0.01, -0.04)}, Cylinder((0.5, -0.3), 0.3)),
    "space": (BOX, (8, 9), {"motion": (0.01, 0.005, -0.08)}, Sphere((0.5, 0.625, -0.5), 0.5)),
    "rollers": (1.0, 16, ROLLERS | {"motion": (0.0, -0.04)}, Cylinder((0.1, -0.3), 0.3)),
    "held": (
        1.0, 16, {"sides": "y", "top": "xy", "motion": (0.01, 0.0)},
        Rigid(Cylinder((0.45, -0.3), 0.3), displacement=(0.0, 0.04)),
    ),
    "mixed": (
        BOX, (8, 9), {"motion": (0.01, 0.0, -0.08), "sides": ("periodic", "y")},
        Sphere((0.5, 0.1, -0.5), 0.5),
    ),
    "box": (BOX, (8, 9), IN_A_BOX | {"motion": (0, 0, -0.08)}, Sphere((0.1, 1.0, -0.5), 0.5)),
    "Adini": (1.0, 16, PLANE_ADINI | {"motion": (0.01, -0.04)}, Cylinder((0.5, -0.3), 0.3)),
    "Adini on rollers": (
        1.0, 16, PLANE_ADINI | ROLLERS | {"motion": (0.0, -0.04)},
        Rigid(Cylinder((0.9, -0.3), 0.3), displacement=(0.02, 0.0)),
    ),
    "Adini in space": (
        BOX, (6, 7), SPACE_ADINI | {"motion": (0.01, 0.005, -0.08)}, Sphere((0.5, 0.625, -0.5), 0.5)
    ),
    "Adini in a box": (
        BOX, (6, 7), SPACE_ADINI | IN_A_BOX | {"motion": (0, 0, -0.08)},
        Sphere((0.1, 1.0, -0.5), 0.5),
    ),
    # The sides hold what the obstacle moves along: those points slip by a known amount.
    "pushed to the right": (1.0, 8, ROLLERS, flat(0.02, 0.03)),
    "pushed to the left": (1.0, 8, ROLLERS, flat(-0.02, 0.03)),
    "at rest": (1.0, 8, ROLLERS, flat(0.0, 0.03)),
    "sticks and slips": (1.0, 12, ROLLERS, flat(0.004, 0.03)),
    "pushed in a box": (BOX, (6, 5), IN_A_BOX, flat(0.02, -0.01, 0.03)),
    "sticks in a box": (BOX, (6, 5), IN_A_BOX, flat(3e-3, -2e-3, 0.03)),
    **{
        f"one roller, {motion}": (
            BOX, (6, 7), {"sides": ("x", "periodic")},
            Rigid(Sphere((0.05, 0.6, -0.65), 0.6), displacement=motion),
        )
        for motion in ((0.02, 0.0, 0.1), (0.0, 0.01, 0.1), (0.001, 0.002, 0.1))
    },
}  # fmt: skip


def layers(case):
    lengths, cells, settings, obstacle = CASES[case]
    return PeriodicLayers(lengths, COATED, cells, **settings), obstacle


def agree(block, grid, mesh, tol=1e-10):
    """Pressures, shear vectors, sums, states and displacements."""
    dim, size = block.dim, mesh.pressure.max()
    assert size > 0

    def place(x):
        return [np.rint(p / h).astype(int) for p, h in zip(x, block.spacing, strict=False)]

    at = place(mesh.x_nominal)
    inside = np.all([k < n for k, n in zip(at, block.shape, strict=True)], axis=0)
    at = tuple(k[inside] for k in at)
    assert np.abs(grid.pressure[at] - mesh.pressure[inside]).max() < tol * size
    shear = np.einsum("djm,mj->dm", mesh.system.rows.tangents, mesh.shear)
    for c, own in enumerate(grid.shear):
        assert np.abs(own[at] - shear[c, inside]).max() < tol * size
    assert np.abs(grid.resultant - mesh.resultant).max() < tol * np.abs(mesh.resultant).max()
    ours, theirs = grid.status[at], mesh.status[inside]
    if mesh.system.law is None:  # whether a point sticks has no meaning
        ours, theirs = ours == Status.OPEN, theirs == Status.OPEN
    assert np.array_equal(ours, theirs)
    basis = mesh.system.body.basis
    low = basis.mesh.p[-1] < 1e-9
    here = tuple(k % n for k, n in zip(place(basis.mesh.p[:, low]), block.shape, strict=True))
    for c in range(dim):
        error = grid.u[c][here] - mesh.u[basis.nodal_dofs[c, low]]
        assert np.abs(error).max() < 1e-9 * np.abs(mesh.u).max()


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("law", "friction"), [(None, 0.0), ("coulomb", F), ("coulomb", 0.9), ("tresca", 0.01)]
)
@pytest.mark.parametrize("case", CASES)
def test_layers_are_those_of_the_sparse_path(case, law, friction):
    block, obstacle = layers(case)
    if law == "tresca" and not np.all(block.mirrored):
        pytest.skip("given friction acts where the mesh ties its ends, too: not determined there")
    grid = GridContact(block, obstacle, friction, law or "coulomb").solve()
    functional = "nodal" if "Adini" in case else None
    problem = ContactProblem(block.elastic(), "bottom", obstacle, friction, law, functional)
    agree(block, grid, problem.solve())
    if "pushed to" in case and friction in (F, 0.01):
        assert np.all(grid.status == Status.SLIP)
        bound = friction * grid.resultant[1] if law == "coulomb" else friction
        assert abs(grid.resultant[0]) == pytest.approx(bound, rel=1e-10)
    if case == "at rest" and law:
        assert np.all(grid.status[[0, -1]] == Status.UNDETERMINED)
        assert not np.any(grid.shear[0][[0, -1]])


@pytest.mark.parametrize("case", ["pushed to the right", "pushed in a box"])
@pytest.mark.filterwarnings("ignore")  # a motion far beyond a facet, of a plane along itself
@pytest.mark.parametrize("far", [1.0, 1e4])
def test_histories_agree(case, far):
    block, _ = layers(case)
    path = np.array([0.01, 0.02, 0.012, 0.012, 0.0]) * far
    steps = [flat(*[x] * (block.dim - 1), 0.03) for x in path]
    grids = GridContact(block, steps[0], F).history(steps)
    stepper = LoadStepper(ContactProblem(block.elastic(), "bottom", steps[0], F))
    stepper.obstacle(lambda t: steps[round(t)])
    for grid, mesh in zip(grids, stepper.run(np.arange(5.0)), strict=True):
        agree(block, grid, mesh)


def test_a_box_on_rollers_is_a_quarter_of_the_mirrored_periodic_body():
    heights = 0.02 * np.random.default_rng(2).uniform(0, 1, (9, 7))
    twice = np.concatenate((heights, heights[-2:0:-1]))
    twice = np.concatenate((twice, twice[:, -2:0:-1]), axis=1)
    ground = {"displacement": (0.0, 0.0, 0.012)}
    quarter = PeriodicLayers((1.0, 0.75), COATED, (8, 6), sides=("x", "y"))
    whole = PeriodicLayers((2.0, 1.5), COATED, (16, 12))
    ours = GridContact(quarter, Rigid(heights, **ground), 0.3).solve()
    full = GridContact(whole, Rigid(twice, **ground), 0.3).solve()
    assert 0.1 < ours.area / 0.75 < 0.9
    assert np.abs(ours.pressure - full.pressure[:9, :7]).max() < 1e-9 * ours.pressure.max()
    assert np.abs(ours.shear - full.shear[:, :9, :7]).max() < 1e-9 * ours.pressure.max()
    for name in ("area", "perimeter", "corrected_area"):
        assert getattr(ours, name) == pytest.approx(getattr(full, name) / 4)
    assert ours.resultant[2] == pytest.approx(full.resultant[2] / 4)
    with pytest.raises(InputError, match="spectrum: the surface is not periodic"):
        ours.spectrum()


def test_an_obstacle_that_enters_a_held_side_is_named():
    block = PeriodicLayers(1.0, COATED, 8, sides="y")
    with pytest.raises(Infeasible, match=r"enters grid point \(0,\) by 0.01, where a side holds"):
        GridContact(block, Rigid(np.zeros(9), displacement=(0.0, 0.01))).solve()
    block = PeriodicLayers((1.0, 1.0), COATED, (1, 3), sides=("yz", "periodic"))
    with pytest.raises(InputError, match="compliance: its sides fix the normal displacement"):
        GridContact(block, Rigid(0.0, displacement=(0.0, 0.0, 0.1)))


@pytest.mark.parametrize("motion", [1e-5, 1e-3])
@pytest.mark.parametrize("friction", [0.05, 3.0])
def test_an_obstacle_moved_along_points_that_rollers_hold(motion, friction):
    """They slip, however little it moves; elsewhere forces are those of the sparse path."""
    block = PeriodicLayers(1.0, COATED, 8, sides="x")
    bowl = Rigid(lambda x: 0.02 * (x[0] - 0.3) ** 2, displacement=(motion, 0.01))
    grid = GridContact(block, bowl, friction).solve()
    assert grid.pressure[0] > 0
    assert grid.status[0] == Status.SLIP
    assert grid.shear[0, 0] == pytest.approx(friction * grid.pressure[0])
    agree(block, grid, ContactProblem(block.elastic(), "bottom", bowl, friction).solve(), 1e-11)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("dim", [2, 3])
def test_an_obstacle_driven_by_a_force_along_sides_that_hold_it(dim, law):
    """Points on the sides stick and take what the others do not, so that it does not move."""
    sides, cells = (("x",), (6,)) if dim == 2 else (("x", "y"), (6, 5))
    block = PeriodicLayers((1.0,) * (dim - 1), COATED, cells, sides=sides)
    heights = 0.01 * np.random.default_rng(2).uniform(0, 1, block.shape)
    heights[(0,) * (dim - 1)] = 0.0
    drag = (0.002,) * (dim - 1)
    friction = 0.5 if law == "coulomb" else 0.02
    result = GridContact(block, Rigid(heights, force=(*drag, 0.02)), friction, law).solve()
    assert result.resultant == pytest.approx((*drag, 0.02))
    assert np.abs(result.motion[:-1]).max() < 1e-12
    assert max(result.kkt.values()) < 1e-10
    assert result.status[(0,) * (dim - 1)] == Status.STICK


def test_given_friction_cycles_within_coulomb_friction():
    """A bending plate between held sides: Newton's method cycles with given friction, too."""
    plate = [(0.4, 4, 1700.0, -0.3), (6e-4, 3, 2.4, 0.49), (0.37, 4, 2.4, 0.499)]
    block = PeriodicLayers(0.9, plate, 16, sides="y", top="x", plane="stress")
    gaps = 1e-5 * np.random.default_rng(0).integers(3, 34, 17)
    gaps[[0, -1]] = 1.0
    ground = Rigid(gaps, displacement=(-4.4e-5, 3.4e-4))
    assert max(GridContact(block, ground, 0.3).solve().kkt.values()) < 1e-10


def test_given_friction_holds_a_drag_without_contact():
    """Tresca's bound acts on open points, too: they stick and share the force, in pascals."""
    pascals = [(height, cells, 1e11 * E, nu) for height, cells, E, nu in COATED]
    block = PeriodicLayers(1.0, pascals, 6, top="y")
    ground = Rigid(0.02, displacement=(None, 0.01), force=(3e8, None))
    result = GridContact(block, ground, 1e9, "tresca").solve()
    assert not result.pressure.any()
    assert result.shear[0] == pytest.approx(np.full(6, 3e8))


ADINI = {2: ElementQuadAdini, 3: ElementHexAdini}


@dataclass(frozen=True, eq=False)
class SparseCompliance:
    """Displacements of the lower nodes by the stiffness matrix of the body on its mesh, a matrix.

    A body that nothing holds is displaced by the pseudo-inverse, its mean force left out: its
    translations are the obstacle's.
    """

    matrix: np.ndarray
    initial: np.ndarray
    block: PeriodicLayers

    def __getattr__(self, name):
        return getattr(self.block, name)

    @classmethod
    def of(cls, block):
        body, dim = block.elastic(), block.dim
        places = body.mesh.p
        low = np.flatnonzero(
            (abs(places[-1]) < 1e-9 * places[-1].max())
            & np.all(
                [(places[a] < (1 - 1e-9) * block.lengths[a]) | block.mirrored[a]
                 for a in range(dim - 1)], axis=0,
            )
        )  # fmt: skip
        at = [np.rint(places[a, low] / block.spacing[a]).astype(int) for a in range(dim - 1)]
        order = np.argsort(np.ravel_multi_index(at, block.shape))
        dofs = body.basis.nodal_dofs[:dim, low[order]].ravel()
        P, u0 = body.constraint
        S = (P.T @ body.stiffness @ P).toarray()
        loads = np.zeros((body.basis.N, dofs.size))
        loads[dofs, np.arange(dofs.size)] = 1.0
        parts = loads.reshape(body.basis.N, dim, -1)
        shares = block.weights.ravel() / block.weights.sum()
        for c in np.flatnonzero(block.constant):
            parts[dofs.reshape(dim, -1)[c], c] -= shares[:, None]
        unit = 1.0 / np.sqrt(np.diag(S))
        scaled = S * unit * unit[:, None]
        solve = np.linalg.inv if not block.constant.any() else _pseudo_inverse
        inverse = unit[:, None] * solve(scaled) * unit
        W = (P @ (inverse @ (P.T @ loads)))[dofs]
        initial = (P @ (inverse @ (P.T @ (-body.stiffness @ u0))) + u0)[dofs]
        if block.constant.any():
            W, initial = _centred(W, block), _centred(initial[:, None], block)[:, 0]
        return cls(W, initial.reshape(dim, *block.shape), block)

    def apply(self, forces):
        return (self.matrix @ forces.ravel()).reshape(forces.shape)


def _pseudo_inverse(S):
    return np.linalg.pinv(S, rcond=1e-13, hermitian=True)


def _centred(columns, block):
    """Displacements without the mean of components that nothing holds."""
    parts = columns.reshape(block.dim, -1, columns.shape[1]).copy()
    for c in np.flatnonzero(block.constant):
        parts[c] -= block.weights.ravel() @ parts[c] / block.weights.sum()
    return parts.reshape(columns.shape)


def on_the_sparse_body(contact, result):
    """With the displacements of the sparse body the solution is certified as well."""
    sparse = replace(contact, compliance=SparseCompliance.of(contact.compliance))
    problem, dim = sparse._case(None).problem(), contact.compliance.dim
    a = -problem.turned(result.motion.reshape(-1, *[1] * (dim - 1))).ravel()
    a[np.isnan(problem.force)] = 0.0
    law = contact._case(None).friction_law(np)
    certified(problem, law, (result.forces, a), contact._controls()[0], 1e-8, ())
    assert max(result.kkt.values()) < 1e-10


def random_sides(rng):
    """Layers between sides of all kinds, in any units."""
    dim = int(rng.choice([2, 2, 3]))
    unit, modulus = (float(10 ** rng.uniform(low, high)) for low, high in ((-9, 6), (-12, 12)))
    kinds = [["x", "y"]] if dim == 2 else [["periodic", "x", "yz"], ["periodic", "y", "xz"]]
    sides = [str(rng.choice(kind)) for kind in kinds]
    cells = [int(rng.integers(2, 12 if dim == 2 else 5)) for _ in sides]
    parts = [
        (unit * rng.uniform(0.1, 0.6), int(rng.integers(1, 4)), modulus * 10 ** rng.uniform(-1, 1),
         float(rng.choice([0.0, 0.3, 0.45])))
        for _ in range(rng.integers(1, 4))
    ]  # fmt: skip
    top = [None, "xyz"[dim - 1], "x"][rng.integers(3)]
    element = ADINI[dim]() if rng.random() < 0.3 else None
    lengths = tuple(unit * rng.uniform(0.7, 1.5, dim - 1))
    return PeriodicLayers(lengths, parts, cells, sides=sides, top=top, element=element)


def random_contact(seed):
    """Obstacles moved or driven along rollers and held sides, without friction or by both laws."""
    rng = np.random.default_rng([25, seed])
    block = random_sides(rng)
    dim, height = block.dim, sum(layer.height for layer in block.layers)
    rise = height * 10 ** rng.uniform(-4, -2)
    gaps = np.where(block.fixed[-1], 1e3 * height, rise * rng.random(block.shape))
    pressure = rise * rng.uniform(0.1, 0.6) / sum(l.height / l.E for l in block.layers)
    law = str(rng.choice(["coulomb", "tresca"]))
    friction = float(rng.choice([0.0, 0.05, 0.3, 1.0])) * (pressure if law == "tresca" else 1.0)
    pressed = bool(block.constant[-1]) or rng.random() < 0.5
    grip = friction * (pressure * pressed if law == "coulomb" else 1.0) * np.prod(block.lengths)
    motion, force = [None] * dim, [None] * dim
    for i in range(dim - 1):
        if block.constant[i] or rng.random() < 0.4:
            force[i] = 0.1 * grip * rng.uniform(-1, 1)
        else:
            motion[i] = rise * rng.uniform(-1, 1)
    if pressed:
        force[-1] = pressure * np.prod(block.lengths)
    else:
        motion[-1] = rise * rng.uniform(0.2, 0.9)
    drive = {"displacement": tuple(motion)} if any(m is not None for m in motion) else {}
    drive |= {"force": tuple(force)} if any(f is not None for f in force) else {}
    friction = friction * rng.uniform(0.5, 1.0, block.shape) if rng.random() < 0.3 else friction
    return GridContact(block, Rigid(gaps, **drive), friction, law)


@pytest.mark.parametrize(
    "seeds",
    [
        *(pytest.param([seed], marks=pytest.mark.sampled(6)) for seed in range(24) if seed != 7),
        pytest.param(range(300), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_contacts_between_sides_of_all_kinds(seeds):
    for seed in seeds:
        contact = random_contact(seed)
        on_the_sparse_body(contact, contact.solve())
