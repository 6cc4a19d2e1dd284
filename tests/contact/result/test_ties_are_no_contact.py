"""Forces of contact, their statistics, words and pictures are its own; ties have theirs."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from pressed_pairs import pair, stack
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP1, MeshHex, MeshQuad, MeshTri

from contact import (
    ContactProblem,
    ContactResult,
    ElasticBody,
    LoadStepper,
    Pair,
    Status,
    Tie,
    recheck,
    uniqueness,
)
from contact.plot import face_pressure
from skfem_adini import ElementQuadAdini

LOAD = 0.05
PLANAR = {"Q1": (MeshQuad, ElementQuad1), "P1": (MeshTri, ElementTriP1)}
PLANAR |= {"Q2": (MeshQuad, ElementQuad2), "Adini": (MeshQuad, ElementQuadAdini)}


def pressed(turned=False, kind="Q1", dim=2, friction=0.2, pull=0.0):
    """A block loaded by LOAD on a coating, which is tied to a foundation; the tie may be turned."""
    cells, element = PLANAR[kind] if dim == 2 else (MeshHex, ElementHex1)
    axis, name = 1, "xyz"[:dim]

    def body(low, height, n, E):
        p = np.zeros(dim)
        p[axis] = low
        scale = np.ones(dim)
        scale[axis] = height
        mesh = cells().refined(n).scaled(scale).translated(p).with_defaults()
        return ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3)

    base, coat, ball = body(0.0, 1.0, 1, 3.0), body(1.0, 0.25, 2, 1.0), body(1.25, 1.0, 2, 2.0)
    top, bottom = "top", "bottom"
    base.named("base").fix(bottom, name)
    coat.named("coat")
    force = np.zeros(dim)
    force[axis] = -LOAD
    ball.named("ball").fix("left", "x").load(top, force)
    if dim == 3:
        ball.fix("front", "z")
    if pull:
        coat.load("right", [pull, *np.zeros(dim - 1)])
    tie = Tie(base, top, coat, bottom) if turned else Tie(coat, bottom, base, top)
    return ContactProblem([ball, coat, base], [Pair(ball, bottom, coat, top, friction), tie])


@pytest.mark.parametrize("kind", PLANAR)
@pytest.mark.parametrize("turned", [False, True])
def test_contact_carries_the_load_once(kind, turned):
    result = pressed(turned, kind).solve()
    ties = result.status == Status.BONDED
    assert result.contact_force == pytest.approx(LOAD, rel=1e-9)
    assert result.tie_force == pytest.approx(LOAD, rel=1e-9)
    side = -1 if turned else 1
    assert result.resultant[1] == pytest.approx(LOAD, rel=1e-9)
    assert result.resultants[:, 1] == pytest.approx([LOAD, 0.0], abs=1e-9)
    assert result.tie_resultants[:, 1] == pytest.approx([0.0, side * LOAD], abs=1e-9)
    assert result.resultants[0, 0] == pytest.approx(side * result.tie_resultants[1, 0], abs=1e-9)
    assert not result.resultants[1].any()
    assert not result.tie_resultants[0].any()
    weights = result.system.rows.weights
    assert not result.pressure[ties].any()
    assert not result.shear[ties].any()
    assert not result.tie_pressure[~ties].any()
    assert not result.tie_shear[~ties].any()
    assert weights @ result.pressure == pytest.approx(LOAD, rel=1e-9)
    assert weights @ result.tie_pressure == pytest.approx(LOAD, rel=1e-9)
    whole = (result.pressure + result.tie_pressure) * weights
    np.testing.assert_allclose(whole, result.mu, rtol=1e-15)  # divided and multiplied
    assert result.zone[1] == pytest.approx([1.25, 1.25])
    centre = result.centre_of_pressure
    assert centre[0, 1] == pytest.approx(1.25)
    assert np.isnan(centre[1]).all()


def test_forces_on_each_body_are_parted():
    """On the coating contact and tie balance each other; reactions know both."""
    result = pressed(pull=0.01).solve()
    down, up = np.array([0.0, -LOAD]), np.array([0.0, LOAD])
    assert result["ball"].resultant[1] == pytest.approx(up[1], abs=1e-9)
    assert result["ball"].tie_resultant == pytest.approx([0.0, 0.0], abs=1e-12)
    coat = result["coat"]
    # The pull of .01 on an edge of length .25 goes to the tie; friction within may go either way.
    assert (coat.resultant + coat.tie_resultant)[0] == pytest.approx(-0.01 * 0.25, abs=1e-9)
    assert coat.resultant[1] == pytest.approx(down[1], abs=1e-9)
    assert coat.tie_resultant[1] == pytest.approx(up[1], abs=1e-9)
    assert result["base"].resultant == pytest.approx([0.0, 0.0], abs=1e-12)
    assert result["base"].tie_resultant == pytest.approx(-coat.tie_resultant, abs=1e-9)
    for one in (result, *(result[name] for name in ("ball", "coat", "base"))):
        balance = one.balance()
        assert np.abs(balance.pop("residual")).max() < 1e-9
        assert sum(balance.values()) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert coat.balance()["tie"] == pytest.approx(coat.tie_resultant)
    assert "tie" not in result["ball"].balance()


def test_in_space(tmp_path):
    result = pressed(dim=3).solve()
    ties = result.status == Status.BONDED
    assert result.contact_force == pytest.approx(LOAD, rel=1e-9)
    assert result.resultant[1] == pytest.approx(LOAD, rel=1e-9)
    facets, pressure = face_pressure(result)
    assert facets.size == 16
    assert pressure.mean() == pytest.approx(result.pressure[~ties].mean(), rel=0.1)
    ax = result.plot()
    assert len(ax.collections) == 1
    assert ax.collections[0].get_array().size == 16
    plt.close("all")


def test_tie_alone_is_no_contact():
    cube = MeshHex().refined(1).with_defaults()
    low = ElasticBody.from_mesh(cube, E=1.0, nu=0.0).fix("bottom", "xyz")
    above = cube.translated((0.0, 1.0, 0.0)).with_defaults()
    high = ElasticBody.from_mesh(above, E=1.0, nu=0.0).load("top", (0.0, 0.1, 0.0))
    result = ContactProblem([high, low], [Tie(high, "bottom", low, "top")]).solve()
    assert result.contact_force == 0.0
    assert not result.resultant.any()
    assert result.tie_force == pytest.approx(-0.1, rel=1e-9)
    assert np.isnan(result.zone).all()
    assert "none" in result.summary()
    assert result.plot().collections[0].get_array().mean() == pytest.approx(-0.1, rel=1e-6)
    plt.close("all")


def test_what_is_said_drawn_and_written(tmp_path):
    result = pressed().solve()
    said = result.summary()
    assert "tie 1" in said
    assert "contact 1" not in said
    assert f"at most {result.pressure.max():.6g}" in said
    assert repr(result).endswith(f", {LOAD:.6g}))")
    ax = result.plot()
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"tie, normal", "tie, shear", "bonded"} <= set(names)
    assert len(set(names)) == len(names)
    plt.close("all")
    blocks = result.to_pyvista()
    assert blocks.keys()[-2:] == ["tie 1", "tie 1 opposite"]
    tie, opposite = blocks["tie 1"], blocks["tie 1 opposite"]
    assert not tie["pressure"].any()
    assert tie["tie_pressure"].min() > 0
    np.testing.assert_array_equal(opposite["tie_shear"], -tie["tie_shear"])
    again = ContactResult.load(result.save(tmp_path / "tied.npz"))
    for name in ("pressure", "tie_pressure", "shear", "tie_shear", "resultants", "tie_resultants"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))


def test_checks_know_both():
    problem = pressed()
    result = problem.solve()
    assert max(recheck(result).values()) < 1e-9
    assert uniqueness(problem, result).others == ()
    history = LoadStepper(pressed()).load("top", (0.0, -LOAD), lambda t: t, body="ball")
    forces = history.run([1.0, 2.0]).resultant[:, 1]
    assert forces == pytest.approx([2 * LOAD, 3 * LOAD], rel=1e-9)
    stacked = stack().solve()
    each = [stacked[k].resultant + stacked[k].tie_resultant for k in range(3)]
    on_plane = stacked.resultants[2]
    assert sum(each) == pytest.approx(on_plane, abs=1e-10)


def lines(result):
    """Names and values of the summary."""
    return dict(
        re.split(r"  +", line.strip(), maxsplit=1) for line in result.summary().split("\n")[1:]
    )


def test_pairs_of_a_stack():
    result = stack().solve()
    said = lines(result)
    assert [name for name in said if "block" in name or "body" in name] == [
        *("top block", "body 1", "low/block")
    ]
    for k, whose in enumerate(("'top block'", "body 1", "'low/block'")):
        line = said["tie 1" if k == 1 else f"contact {k}"]
        assert line.endswith(f"on {whose}")
        assert line.startswith(f"{np.sum(result.part == k)} points: ")
        force = [float(v) for v in re.search(r"; \((.*)\)", line)[1].split(", ")]
        # Six digits are printed.
        assert force == pytest.approx(
            (result.tie_resultants if k == 1 else result.resultants)[k], rel=1e-5, abs=1e-12
        )
    assert "15 bonded" in said["tie 1"]
    assert "bonded" not in said["contact 0"]


def test_table_has_the_same(make):
    result = pair().solve()
    worst = max(result.kkt.values())
    assert lines(result)["certificate"].startswith(f"no residual above {worst:.1e}")
    for value in ("upper", "lower", "contact 0", "on &#x27;upper&#x27;"):
        assert value in result._repr_html_()
    _, alone = make.solved()
    assert list(lines(alone))[:1] == ["body"]
    assert "resultant" in lines(alone)
    assert "contact 0" not in lines(alone)
