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
    table = rows_of("case | ours | the tests allow", rows)
    return f"{table}\n\n{source('validation', record, 'scikit-fem')}"


def periodic(record: Record) -> str:
    """Contact by transforms at 64 points a wave, and the orders over the meshes."""
    cases = record["cases"]
    row = cases["coating"]["points"].index(64)
    rows = []
    for body, words in (
        ("thick block", "a thick block of Adini's elements"),
        ("half plane", "the half plane"),
        ("layers on a half plane", "linear layers on a half plane"),
    ):
        partial = [cases[f"{body}, s = {share}"] for share in (0.2, 0.5, 0.8)]
        pressure, raw, half, _, gap = (max(case["errors"][row][k] for case in partial)
                                       for k in range(5))  # fmt: skip
        orders = [case["orders"][0] for case in partial]
        rows.append(
            (
                f"Westergaard's sinusoid in partial contact, {words}; 64 points a wave",
                f"rms pressure error {pressure:.1e} of the largest ({raw:.1e} by forces alone), "
                f"half-width {half:.1e}, mean gap {gap:.1e} of the height; order "
                f"{min(orders):.1f} to {max(orders):.1f}",
                "1e-3, .7 to 2.3",
            )
        )
    full = cases["thick block, s = 1.2"], cases["two waves, full contact"]
    light, ball = cases["two waves, light contact"], cases["ball"]
    coating, linear = cases["coating"], cases["coating, linear cells"]
    rows += [
        (
            "full contact of a sinusoid, 64 points a wave, and of Johnson's two waves, "
            f"{full[1]['points'][1]} points a period, on a thick block of Adini's elements",
            "; ".join(
                f"{case['errors'][1][0]:.1e}, order {case['orders'][0]:.2f}" for case in full
            ),
            "1e-3, 2.8 to 3.2",
        ),
        (
            f"Johnson's two waves in light contact, {light['points'][1]} and "
            f"{light['points'][2]} points a period (64 and 128 a wave)",
            "; ".join(
                f"rms pressure error {errors[0]:.1e} ({errors[1]:.1e} by forces alone)"
                for errors in light["errors"][1:]
            )
            + f"; order {light['orders'][0]:.1f}",
            "1e-3, 4e-4, 1.7 to 2.6",
        ),
        (
            f"Hertz' ball in a period of 7 radii, {ball['points'][0]} points a period",
            f"rms pressure error {ball['errors'][0][0]:.1e} of p0 ({ball['errors'][0][1]:.1e} by "
            f"forces alone), radius {ball['errors'][0][2]:.1e}; order {ball['orders'][0]:.1f}",
            "1e-3, 2.5e-3, .8 to 2",
        ),
        (
            "coating of an eighth of the wave, E 100 : 1, beside its closed form, 64 points a wave",
            f"{max(coating['errors'][row]):.1e}, order {min(coating['orders']):.2f} (Adini's "
            f"elements, kinked interfaces); {max(linear['errors'][row]):.1e}, order "
            f"{min(linear['orders']):.2f} (linear)",
            "1e-3, 2.8 to 3.2",
        ),
    ]
    table = rows_of("case | ours | the tests allow", rows)
    return f"{table}\n\n{source('validation', record, 'scikit-fem')}"
