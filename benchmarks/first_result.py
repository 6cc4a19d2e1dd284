"""How long a fresh process takes to its first results, with machine code on disk and without.

Each case is a block of the README or the guide in a process of its own: seconds to import, to the
first result, and to the same result again. "cold" has an empty folder for machine code, so that
whatever must be compiled is; "warm" is the least of several later processes. The time of Python's
start is not counted. A busy machine makes all of them longer: `busy` is the load at the beginning.

    python benchmarks/first_result.py
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

# The folder of this script holds cip.py: the package must be found first.
ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "first_result.json"
CASES = {
    "contact": (
        "from skfem import MeshQuad\n"
        "from contact import ContactProblem, ElasticBody, Plane\n"
        "from skfem_adini import ElementQuadAdini",
        "body = ElasticBody.from_mesh(MeshQuad().refined(3).with_defaults(), ElementQuadAdini(),"
        " E=2.0, nu=0.3)\n"
        "body.fix('top', 'x').fix(['left', 'right'], 'y').load('top', (0.0, -1.0))\n"
        "ContactProblem(body, 'bottom', Plane((0, -0.03), (0, 1)), friction=0.9).solve()",
    ),
    "contact of bricks": (
        "from skfem import MeshHex\nfrom contact import ContactProblem, ElasticBody, Sphere",
        "body = ElasticBody.from_mesh(MeshHex().refined(3).with_defaults(), E=1.0, nu=0.3)\n"
        "ContactProblem(body.fix('front'), 'back', Sphere((.5, .5, 1.98), 1.0)).solve()",
    ),
    "element": (
        "from skfem import Basis, MeshQuad, condense, solve\n"
        "from skfem.models.poisson import laplace, unit_load\n"
        "from skfem_adini import ElementQuadAdini, essential_dofs",
        "basis = Basis(MeshQuad().refined(4), ElementQuadAdini())\n"
        "A, b = laplace.assemble(basis), unit_load.assemble(basis)\n"
        "solve(*condense(A, b, D=essential_dofs(basis)))",
    ),
    "transport": (
        "import numpy as np\nfrom cip import Grid, Solver",
        "solver = Solver(Grid((-2, 2), 200), lambda x: x - x**3, form='advection',"
        " profile='csl4', boundary=0.0)\n"
        "solver.run(solver.state(lambda x: np.exp(-10 * x**2)), 1.0, dt=0.02)",
    ),
    "quadratic program": (
        "import numpy as np\nfrom gpu import solve_qp",
        "solve_qp(np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([-1.0, -1.0]), G=[[1.0, 1.0]],"
        " h=[1.0], lb=0.0)",
    ),
}
SCRIPT = """
import json, time
begin = time.perf_counter()
{imports}
seconds = [time.perf_counter() - begin]
def once():
{body}
for _ in range(2):
    begin = time.perf_counter()
    once()
    seconds.append(time.perf_counter() - begin)
print(json.dumps(seconds))
"""


def measured(case: str, folder: str) -> list[float]:
    """Seconds to import, of the first result, and of the second, in a process of its own."""
    imports, body = CASES[case]
    script = SCRIPT.format(imports=imports, body="\n".join(f"    {b}" for b in body.split("\n")))
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": folder}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, check=True, capture_output=True, text=True
    )
    found: list[float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--no-record", action="store_true", help="print only")
    options = parser.parse_args(arguments)
    rows, busy = [], os.getloadavg()[0]
    print("case               import  cold: first  again   warm: first  again")
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder:
            cold = measured(case, folder)
            later = [measured(case, folder) for _ in range(options.repetitions)]
        warm = [min(seconds) for seconds in zip(*later, strict=True)]
        rows.append({"case": case, "cold": cold, "warm": warm})
        first = f"{cold[1]:12.2f} {cold[2]:6.3f} {warm[1]:13.2f} {warm[2]:6.3f}"
        print(f"{case:18} {warm[0]:6.2f} {first}", flush=True)
    if not options.no_record:
        sys.path.insert(0, str(Path(__file__).parent))
        from machine import describe

        record = {"machine": describe(), "busy": busy, "rows": rows}
        RESULTS.write_text(json.dumps(record, indent=1) + "\n")
        print(f"written to {RESULTS.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
