"""Press a part from a mesh file on a plane or a tool: ``python -m contact part.inp --help``."""

from __future__ import annotations

import argparse
import logging
import sys
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem import Basis, FacetBasis, Mesh

from contact import (
    ContactError,
    ContactProblem,
    ContactResult,
    ElasticBody,
    InputError,
    Plane,
    Rigid,
    SurfaceMesh,
)
from contact.body.boundary_names import read_mesh
from contact.body.cell_check import check_cells
from contact.result.contact_fields import vector
from skfem_adini import ElementHexAdini, ElementQuadAdini
from skfem_adini.ground.arguments import finite_number

Array = NDArray[np.float64]
ELEMENTS = {
    ("p1", 2): skfem.ElementTriP1, ("p2", 2): skfem.ElementTriP2,
    ("q1", 2): skfem.ElementQuad1, ("q2", 2): skfem.ElementQuad2, ("adini", 2): ElementQuadAdini,
    ("p1", 3): skfem.ElementTetP1, ("p2", 3): skfem.ElementTetP2,
    ("q1", 3): skfem.ElementHex1, ("q2", 3): skfem.ElementHex2, ("adini", 3): ElementHexAdini,
}  # fmt: skip
EPILOG = """\
A boundary is a name in the mesh file (a physical group of Gmsh, a set of nodes of Abaqus). A mesh
without names gets those of its box: left, right (across x), bottom, top (y), front, back (z).

  python -m contact part.msh --check
  python -m contact part.inp --E 210e3 --nu 0.3 --fix top --press bottom --by 0.02 --friction 0.3
  python -m contact part.inp --E 6 --nu 0.45 --fix mount:x --load mount=0,-0.2 --press nose \\
      --on die.stl --out pressed.vtu
  python -m contact case.toml --friction 0.5

The last one reads the options from a file, by the same names; those of the command line come first:

  mesh = "part.inp"
  E = 210e3
  nu = 0.3
  fix = ["top", "left:x"]
  press = "bottom"
  by = 0.02
"""


def parser() -> argparse.ArgumentParser:
    """The options; their values are texts and numbers, checked later."""
    made = argparse.ArgumentParser(
        prog="python -m contact", description="Press an elastic part on a rigid plane or tool.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False,
    )  # fmt: skip
    add = made.add_argument
    add("mesh", help="mesh file (.msh, .inp, .vtu, ... by meshio), or options in a .toml file")
    add("--check", action="store_true", help="describe the mesh, and stop")
    add("--E", type=float, help="Young's modulus; with lengths in mm in MPa, then forces are in N")
    add("--nu", type=float, help="Poisson's ratio")
    add("--plane", help="strain (default), stress or axisymmetric, of a mesh in the plane")
    add("--element", help="p1, p2, q1, q2 or adini; default: p2, q2, in space p1, q1")
    add("--fix", action="append", metavar="NAME[:XYZ[=VALUE]]",
        help="hold a boundary, or move its components by a value; may be repeated")  # fmt: skip
    add("--load", action="append", metavar="NAME=X,Y[,Z]", help="traction on a boundary")
    add("--press", metavar="NAME", help="the boundary that touches")
    add("--on", metavar="plane|FILE", help="plane (default; it touches the boundary), or the mesh "
        "of a tool's surface where it stands (.stl, .ply, .obj, .vtp)")  # fmt: skip
    add("--direction", metavar="X,Y[,Z]", help="in which the plane or tool presses; default: "
        "against the mean normal of the boundary")  # fmt: skip
    add("--by", type=float, help="how far the plane or tool moves against the boundary")
    add("--force", type=float, help="force of the plane or tool, for each unit of depth in 2-D")
    add("--friction", type=float, help="Coulomb's coefficient; default: none")
    add("--scale", type=float, help="factor of all lengths in the mesh file, 1e-3 for mm in m")
    add("--out", help="file of the body (.vtu); beside it .vtp, .png and .npz; default: result.vtu")
    return made


def options_of(argv: Sequence[str] | None) -> dict[str, Any]:
    """Options of the command line, then of the file of options."""
    parsed = vars(parser().parse_args(argv))
    given = {name: v for name, v in parsed.items() if v is not None and v is not False}
    path = Path(given["mesh"])
    if path.suffix != ".toml":
        return given
    try:
        read = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {error}") from error
    known = {action.dest: action for action in parser()._actions}
    for name, value in read.items():
        if name not in known:
            near = get_close_matches(name, known, 1)
            raise InputError(f"{path}: {name} is no option" + "".join(f"; {n} is" for n in near))
        if known[name].type is float:
            read[name] = finite_number(f"{path}: {name}", value)
        elif name in ("fix", "load"):
            read[name] = [value] if isinstance(value, str) else value
            if not isinstance(read[name], list) or not all(isinstance(v, str) for v in read[name]):
                raise InputError(f'{path}: {name}: expected texts, as in {name} = ["top:x"]')
        elif not isinstance(value, str | bool):
            raise InputError(f"{path}: {name}={value!r}: expected a text")
    if "mesh" not in read:
        raise InputError(f'{path}: mesh is missing, as in mesh = "part.inp"')
    read["mesh"] = str(path.parent / read["mesh"])
    return read | {k: v for k, v in given.items() if k != "mesh"}


def mesh_of(options: dict[str, Any]) -> Mesh:
    """The mesh, in the unit of the body, with names."""
    mesh = read_mesh(options["mesh"])
    if "scale" in options:
        if not 0 < options["scale"] < np.inf:
            raise InputError(f"--scale {options['scale']}: expected a positive number")
        mesh = mesh.scaled(options["scale"])
    return mesh if mesh.boundaries else mesh.with_defaults()


def described(mesh: Mesh) -> str:
    """Size, names and quality of a mesh, in lines."""
    solid = mesh.dim() == 3
    kind = ({4: "tetrahedra", 8: "bricks"} if solid else {3: "triangles", 4: "quadrilaterals"})[
        len(mesh.t)
    ]
    of_cells = Basis(mesh, mesh.elem(), intorder=4).dx.sum(axis=1)
    ends = mesh.p[:, mesh.edges if solid else mesh.facets]
    edges = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)
    size = " x ".join(f"{s:.4g}" for s in np.ptp(mesh.p[:, np.unique(mesh.t)], axis=1))
    lines = [
        f"{mesh.nelements} {kind}, {mesh.doflocs.shape[1]} nodes",
        f"size {size}, {'volume' if solid else 'area'} {of_cells.sum():.6g}",
        "units are yours: with lengths in mm E is in MPa, with lengths in m in Pa",
        f"edges from {edges.min():.3g} to {edges.max():.3g}; the largest cell is "
        f"{of_cells.max() / of_cells.min():.3g} times the smallest",
    ]
    outer, rest = mesh.boundary_facets(), mesh.boundary_facets()
    for name, facets in sorted((mesh.boundaries or {}).items()):
        own, rest = np.intersect1d(facets, outer), np.setdiff1d(rest, facets)
        if not own.size:
            lines.append(f"boundary {name}: no facet on the outside")
            continue
        basis = FacetBasis(mesh, mesh.elem(), facets=own, intorder=4)
        total, places = basis.dx.sum(), np.asarray(basis.global_coordinates())
        middle = ", ".join(f"{v:.4g}" for v in (places * basis.dx).sum(axis=(1, 2)) / total)
        word = "area" if solid else "length"
        lines.append(f"boundary {name}: {own.size} facets, {word} {total:.6g}, about ({middle})")
    return "\n".join([*lines, f"{rest.size} facets of the outside have no name"])


def body_of(mesh: Mesh, options: dict[str, Any]) -> ElasticBody:
    """The part with its material, supports and loads."""
    if not {"E", "nu"} <= set(options):
        raise InputError("--E and --nu: a part needs both; steel in mm: --E 210e3 --nu 0.3")
    element = options.get("element")
    if element is not None:
        if (element.lower(), mesh.dim()) not in ELEMENTS:
            raise InputError(f"--element {element}: expected p1, p2, q1, q2 or adini")
        element = ELEMENTS[element.lower(), mesh.dim()]()
    material = {"E": options["E"], "nu": options["nu"], "plane": options.get("plane", "strain")}
    body = ElasticBody.from_mesh(mesh, element, **material)
    for text in options.get("fix", []):
        name, _, rest = text.partition(":")
        components, _, value = rest.partition("=")
        body.fix(name, components or None, number("--fix", text, value) if value else 0.0)
    for text in options.get("load", []):
        name, _, rest = text.partition("=")
        traction = [number("--load", text, part) for part in rest.split(",")]
        if len(traction) != body.dim:
            raise InputError(f"--load {text}: expected {body.dim} numbers after {name}=")
        body.load(name, traction)
    return body


def number(option: str, text: str, part: str) -> float:
    """A number in the text of an option."""
    try:
        return float(part)
    except ValueError:
        raise InputError(f"{option} {text}: {part!r} is no number") from None


def direction_of(facets: FacetBasis, options: dict[str, Any]) -> Array:
    """Unit vector in which the tool presses: as given, or against the boundary's mean normal."""
    if "direction" in options:
        text = options["direction"]
        parts = np.array([number("--direction", text, part) for part in text.split(",")])
        if parts.size != facets.mesh.dim() or not 0 < np.linalg.norm(parts) < np.inf:
            raise InputError(f"--direction {text}: expected {facets.mesh.dim()} numbers, not all 0")
    else:
        parts = -(np.asarray(facets.normals) * facets.dx).sum(axis=(1, 2))
        if np.linalg.norm(parts) < 1e-6 * facets.dx.sum():
            raise InputError(f"--press {options['press']}: faces all sides; give --direction")
    parts = parts / np.linalg.norm(parts)
    return np.where(np.abs(parts) < 1e-9, 0.0, parts)  # rounding of sums over facets


def tool_of(body: ElasticBody, options: dict[str, Any]) -> Any:
    """The plane or tool, moved or pressed against the boundary."""
    mesh, chosen = body.mesh, body.facets(options["press"])
    facets = FacetBasis(mesh, mesh.elem(), facets=chosen, intorder=4)
    towards = direction_of(facets, options)
    moved, on = options.get("by", 0.0) * towards, options.get("on", "plane")
    if on == "plane":
        places = np.asarray(facets.global_coordinates()).reshape(towards.size, -1)
        places = np.hstack((places, mesh.p[:, np.unique(mesh.facets[:, chosen])]))
        first = places[:, int((towards @ places).argmin())]
        tool: Any = Plane((first + moved).tolist(), towards.tolist())
        print(f"on the plane through {vector(first)}, which presses towards {vector(towards)}")
    else:
        tool = SurfaceMesh.from_file(on).translated(moved)
        print(f"on the surface in {on}, which presses towards {vector(towards)}")
    if "force" not in options:
        return tool
    if "by" in options:
        raise InputError("--by and --force: the tool is moved or pressed; leave one of them")
    if np.count_nonzero(towards) > 1:
        raise InputError("--force: the direction is no axis; give --direction, or --by")
    if not options["force"] > 0:
        raise InputError(f"--force {options['force']}: expected a positive number")
    return Rigid(tool, force=[options["force"] * a if a else None for a in towards.tolist()])


def solved(options: dict[str, Any]) -> ContactResult:
    """The result of the problem that the options state."""
    mesh = mesh_of(options)
    if "press" not in options:
        raise InputError(f"--press is missing: one of {', '.join(sorted(mesh.boundaries))} touches")
    body = body_of(mesh, options)
    if not {"by", "force"} & set(options) and not options.get("load"):
        moved = any("=" in text for text in options.get("fix", []))
        if not moved:
            raise InputError("nothing presses: give --by, --force, --load or --fix NAME:Y=VALUE")
    tool = tool_of(body, options)
    return ContactProblem(body, options["press"], tool, options.get("friction", 0.0)).solve()


def written(result: ContactResult, out: Path) -> list[Path]:
    """Files of a result: body, boundary, picture, and everything to load again."""
    out.parent.mkdir(parents=True, exist_ok=True)
    boundary, picture = out.with_name(f"{out.stem}_boundary.vtp"), out.with_suffix(".png")
    result.to_pyvista().save(out)
    result.boundary_to_pyvista().save(boundary)
    drawn(result).savefig(picture, dpi=160, bbox_inches="tight")
    return [out, boundary, picture, result.save(out.with_suffix(".npz"))]


def drawn(result: ContactResult) -> Any:
    """Stress of the deformed body and tractions along the boundary; in space the pressure."""
    from matplotlib.figure import Figure

    from contact.plot import draw_edges, plot_cells

    if result.body.dim == 3:
        figure = Figure(layout="constrained")
        result.plot(figure.add_subplot(projection="3d"))
        return figure
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_cells(result, left, label="von Mises stress")
    draw_edges(result, left, outline=True)
    left.set(xlabel="x", ylabel="y", title="displacements to scale")
    result.plot(right)
    return figure


def main(argv: Sequence[str] | None = None) -> int:
    """Solve what the command line says; 0 if the result has its certificate, else 2."""
    logging.basicConfig(format="%(message)s", level=logging.WARNING)
    try:
        options = options_of(argv)
        if "check" in options:
            mesh = mesh_of(options)
            print(described(mesh))
            check_cells(mesh)
            print("all cells are sound")
            return 0
        out = Path(options.get("out", "result.vtu"))
        if out.suffix != ".vtu":
            raise InputError(f"--out {out}: expected a name that ends in .vtu")
        result = solved(options)
        print(f"{result.summary()}\n{result.certificate()}")
        print("written:", ", ".join(map(str, written(result, out))))
        return 0
    except (ContactError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
