"""The table of the guide's validation, from results/validation.json."""

from __future__ import annotations

from markdown_table import Record, rows_of, source


def validation(record: Record) -> str:
    """Contact beside closed forms and published values, with what the tests allow."""
    line, cgs1, punch = record["hertz line"], record["NAFEMS CGS-1"], record["flat punch"]
    far, order, membrane = record["far field"], record["order"], record["membrane"]
    sphere, rub = record["hertz sphere"], record["cattaneo"]
    pair, meshed = record["two cylinders"], record["two meshes CGS-1"]
    shrink, ties = record["shrink fit"], record["ties"]
    rows = [
        (
            f"Hertz line contact, a/h = {line['cells']}",
            f"rms pressure error {line['pressure']:.1e} of p0, half-width {line['half-width']:.1e}"
            f", order {line['order']:.1f}",
            "5e-4, 1e-3",
        ),
        (
            "NAFEMS CGS-1: 6.21 mm, 3585 MPa",
            f"a = {cgs1['a']:.3f} mm, p_max = {cgs1['p']:.0f} MPa",
            "1 %",
        ),
        (
            "flat punch, pressure at the centre over the formula's, a/h = 16",
            f"{punch['gauss']:.4f} (`gauss`), {punch['bernstein']:.3f} (`bernstein`)",
            ".5 %, 3 %",
        ),
        (
            "Hertz sphere, a/h = 4",
            f"p0 {sphere['p0']:.3f}, radius {sphere['a']:.3f} of the formula's",
            "2 % at a/h = 8",
        ),
        (
            "Cattaneo-Mindlin under a load history, a/h = 24",
            f"rms shear off by at most {rub['worst']:.4f} F p0 at {rub['instants']} instants, "
            f"{rub['turns']:.4f} at the turns; stick edge within {rub['edge']:.2f} cell",
            ".01",
        ),
        (
            "stress far below, five half-widths and more, beside forces with the pressure's "
            "second moment",
            f"{far['line']:.0e} (line), {100 * far['point']:.2f} % (point contact)",
            "1 %",
        ),
        (
            "order in H1 near the end of contact, and away from it, on Hertz' closed form",
            f"{order['hertz, end']:.2f}, {order['hertz, away']:.2f}",
            "1.5 +- .15, above 1.9",
        ),
        (
            "membrane over a staircase (deal.II step-41)",
            f"force {100 * membrane['force']:.1f} %, contact set "
            f"{100 * membrane['contact set']:.1f} %",
            "1 %",
        ),
        (
            f"two elastic cylinders, E 1:3, cells 1:1.37, a/h = {pair['cells']}",
            "rms pressure error, largest pressure, order: "
            + "; ".join(
                f"{pair['rms'][name]:.1e}, {pair['peak'][name]:.1e}, {pair['order'][name]:.1f} "
                f"({name})"
                for name in pair["rms"]
            ),
            "1e-3, 5e-4, 1.7",
        ),
        (
            "NAFEMS CGS-1, cylinder and block both meshed",
            "; ".join(
                f"a = {found['a']:.3f} mm, p_max = {found['p']:.0f} MPa ({kind} cells)"
                for kind, found in meshed.items()
            ),
            "1 %",
        ),
        (
            f"shrink fit of two rings, {shrink['facets']} facets a quarter",
            "rms pressure error, order: "
            + "; ".join(
                f"{shrink['rms'][name]:.1e}, {shrink['order'][name]:.1f} ({name})"
                for name in shrink["rms"]
            ),
            "1e-3, 1.8",
        ),
        (
            "tied meshes, orders of displacement and gradient, ends held or free",
            "; ".join(f"{low:.2f}, {high:.2f} ({name})" for name, (low, high) in ties.items()),
            "1.9, .95; 2.9, 1.9; 3.85, 2.9",
        ),
    ]
    rows += _periodic(record["periodic"])
    table = rows_of("case | ours | the tests allow", rows)
    return f"{table}\n\n{source('validation', record, 'scikit-fem')}"


def _periodic(cases: Record) -> list[tuple[str, str, str]]:
    """Contact by transforms at 64 points a period, and the orders over the meshes."""
    partial = {name: case for name, case in cases.items() if "s = 0" in name}
    row = cases["coating"]["points"].index(64)
    worst = [max(case["errors"][row][k] for case in partial.values()) for k in range(3)]
    orders = [case["orders"][1] for case in partial.values()]
    full = [
        case for name, case in cases.items() if name.endswith(("block, s = 1.2", "full contact"))
    ]
    fine = cases["coating"]["points"][-1]
    return [
        (
            "Westergaard's sinusoid in partial contact: half plane, thick block, layers on a half "
            "plane; 64 points a wave",
            f"highest pressure {worst[0]:.1e}, longest wave {worst[1]:.1e}, mean gap "
            f"{worst[2]:.1e} of the height; order of the wave {min(orders):.1f} to "
            f"{max(orders):.1f}",
            "1e-3, 1.4 to 2.7",
        ),
        (
            "full contact of a sinusoid, and of Johnson's two waves on a thick block",
            "; ".join(
                f"{case['errors'][-1][0]:.1e}, order {case['orders'][0]:.2f}" for case in full
            ),
            "1e-3, 1.9 to 2.1",
        ),
        (
            "Hertz' ball in a period of 15 radii, a/h = 16",
            f"rms pressure error {cases['ball']['errors'][-1][0]:.1e} of p0, corrected area "
            f"{cases['ball']['errors'][-1][1]:.1e}",
            "5e-3, 1e-3",
        ),
        (
            "coating of an eighth of the wave, E 100 : 1, beside its closed form; "
            f"64 and {fine} points a wave",
            f"{max(cases['coating']['errors'][row]):.1e}, "
            f"{max(cases['coating']['errors'][-1]):.1e}, "
            f"order {min(cases['coating']['orders']):.2f}",
            "2e-3 at 128, 1.85 to 2.1",
        ),
    ]
