"""CUDA C of the feet by displacements (`cip.engines.cuda_displacements`)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

from cip.characteristics.feet import FEET
from cip.engines.cuda_kernels import (
    constants_of,
    for_fields,
    kernel_text,
    modules_of,
    point_of,
    widths_of,
)
from cip.engines.cuda_source import translate
from cip.engines.displacement_loops import coordinates, weights_of
from cip.formulas.expression import statements
from cip.profiles.catalogue import moments

THREADS = 256  # of a block that follows nodes
TILE = (4, 64)  # threads of a block that updates a plane
BLOCKS = 5  # at a time on a multiprocessor, by the measured speed
# Fractions of a sub-step at which the velocity is needed; the second and fourth by halved steps.
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)

# Reduction and polynomials of `displacement_loops.quarter`.
_SINES = """
DEVICE void quarter(double x, double* s, double* c, int* k) {
    const double far = 6755399441055744.0, turns = x * 0.6366197723675814 + far;
    const double n = turns - far;
    *k = __double2loint(turns);
    double y = x - n * 1.5707963267341256;
    y = y - n * 6.077100506303966e-11;
    y = y - n * 2.0222662487959506e-21;
    const double z = y * y;
    double p = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10;
    p = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * p);
    p = -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * p);
    *s = y + y * z * p;
    p = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11;
    p = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * p);
    p = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * p);
    *c = 1.0 - 0.5 * z + z * z * p;
}
DEVICE double fast_sin(double x) {
    double s, c;
    int k;
    quarter(x, &s, &c, &k);
    s = k & 1 ? c : s;
    return k & 2 ? -s : s;
}
DEVICE double fast_cos(double x) {
    double s, c;
    int k;
    quarter(x, &s, &c, &k);
    c = k & 1 ? s : c;
    return k + 1 & 2 ? -c : c;
}
"""
# `displacement_loops.slope` of the numbers around a place of an array.
_SLOPE = """
DEVICE double slope(const double* a, int step, double* more) {
    const double one = a[step] - a[-step], two = a[2 * step] - a[-2 * step];
    const double three = a[3 * step] - a[-3 * step], four = a[4 * step] - a[-4 * step];
    *more = 0.05 * (one - two) + (6.0 / 280.0) * three - (1.0 / 280.0) * four;
    return *more + 0.75 * one - 0.15 * two + (1.0 / 60.0) * three;
}
"""


def _scalars(name: str, count: int, kind: str = "const real") -> list[str]:
    return [f"{kind} {name}{q}" for q in range(count)]


def _listed(name: str, count: int) -> str:
    return ", ".join(f"{name}{q}" for q in range(count)) or "0"


class FollowSource:
    """Kernels of a sub-step of `DeviceDisplacements`: of all nodes (`every`), and of the estimate
    of its error (`halved`). Their arguments: ``old, new, chosen, lines.., step, fresh`` (1: the
    displacements are zero before); of the second the error, an integer; the velocity at three or
    all `TIMES`: numbers that do not depend on the place or, for snapshots, three arrays of
    coefficients combined in time, or all `tables` and their weights."""

    def __init__(self, moved: Any, flow: Any, tables: int, index: str) -> None:
        self._moved, self._flow, self._index, self._tables = moved, flow, index, tables
        self._stage, self._grid, self._moving = moved.stage, moved.grid, moved.stage.moving
        self._letters = "xy"[: len(self._moving)]
        self._held = 0 if tables else len(flow.held)
        self._units = [u / cell for u, cell in zip(flow.unit, moved.cells, strict=False)]
        if moved.field is None:
            source = _formula_source(flow, self._moving)
        else:
            source = _spline_source(flow, moved.field.degrees[1], len(self._moving))
        # A device's own sine has a branch for large angles and shares nothing with the cosine.
        source = re.sub(r"\b(sin|cos)\(", r"fast_\1(", source)
        self._code = _SINES + translate([source], "flow")

    def every(self) -> str:
        """Writes the displacements, NaN where they leave the grid, and to ``chosen[group]`` the
        difference of the inner stages and the number of the node where it is largest."""
        (walls, last), group = self._walls(), self._moved.group
        boxes = [
            f"    const real box{k}[] = {{{_listed(f'b{k}_', self._held)}}};" for k in range(3)
        ]
        lines = [
            "    const index thread = blockIdx.x * blockDim.x + threadIdx.x;",
            "    const index o = thread < size_ ? thread : size_ - 1;",
            *self._place(),
            *([] if self._tables else boxes),
            "    real u, v, a = 0, b = 0, sum_a = 0, sum_b = 0, inner = 0;",
            "    bool gone = false;",
        ]
        for s, (shift, weight, box) in enumerate(((0, 1, 0), (0.5, 2, 1), (0.5, 2, 1), (1, 1, 2))):
            lines += [
                "    {",
                f"    const real x = x0 + {shift} * step * a, y = y0 + {shift} * step * b;",
                f"    gone = gone || {walls};",
                f"    flow(x, y, r, at, box{box}, &u, &v);",
                "    inner = fabs(u - a) + fabs(v - b);" if s == 2 else "",
                f"    sum_a += {weight} * u; sum_b += {weight} * v; a = u; b = v;",
                "    }",
            ]
        lines += [
            "    a = step * (1.0 / 6.0) * sum_a; b = step * (1.0 / 6.0) * sum_b;",
            "    const real x = x0 + a, y = y0 + b;",
            f"    gone = gone || !({last});",
            "    unsigned key = 0;",
            "    if (thread < size_) {",
            *self._each(
                lambda q, x: f"new_[o + {q} * size_] = d{q} + {'ab'[q]} * {self._units[q]!r};"
            ),
            '        if (gone) new_[o] = nan("");',
            "        else key = __float_as_uint((float)inner)",
            f"            / {group}u * {group}u + o % {group};",
            "    }",
            "#if __CUDA_ARCH__ >= 800",
            "    key = __reduce_max_sync(~0u, key);",
            "    if (threadIdx.x % 32 == 0)",
            "#endif",
            f"    atomicMax(chosen + thread / {group}, key);",
        ]
        velocity = [f"const real* __restrict__ box{k}" for k in range(3)]
        if not self._tables:
            velocity = [name for k in range(3) for name in _scalars(f"b{k}_", self._held)]
        bounds = "" if self._tables else f"__launch_bounds__({THREADS}, {BLOCKS}) "
        return self._text(velocity, lines, bounds)

    def halved(self) -> str:
        """Repeats the chosen nodes with two half steps, and writes the largest change as the bits
        of a float32."""
        count, group = self._tables, self._moved.group
        velocity = [*_scalars("t", count, "const real* __restrict__"), *_scalars("w", 5 * count)]
        given = [f"    const real* tables[] = {{{_listed('t', count)}}};",
                 f"    const real weights[] = {{{_listed('w', 5 * count)}}};"]  # fmt: skip
        flow = [
            "        u = 0; v = 0;",
            "        #pragma unroll 1",
            f"        for (int c = {count} * when; c < {count} * (when + 1); c++) {{",
            "            if (weights[c] == 0) continue;",
            "            real one, other;",
            f"            flow(px, py, r, at, tables[c % {count or 1}], &one, &other);",
            "            u += weights[c] * one; v += weights[c] * other;",
            "        }",
        ]
        if not count:
            velocity = _scalars("b", 5 * self._held)
            given = [f"    const real boxes[] = {{{_listed('b', 5 * self._held)}}};"]
            flow = [f"        flow(px, py, r, at, boxes + when * {self._held}, &u, &v);"]
        lines = [
            "    const index thread = blockIdx.x * blockDim.x + threadIdx.x;",
            f"    if (thread >= (size_ + {group - 1}) / {group}) return;",
            "    const unsigned key = chosen[thread];",
            f"    if (key < {group}) return;",
            f"    const index o = thread * {group} + (index)(key % {group});",
            *self._place(),
            *given,
            "    real u, v, x = x0, y = y0, worst = 0;",
            "    #pragma unroll 1",
            "    for (int half = 0; half < 2; half++) {",
            "        real a = 0, b = 0, sum_a = 0, sum_b = 0;",
            "        #pragma unroll 1",
            "        for (int s = 0; s < 4; s++) {",
            "        const int when = 2 * half + (s + 1) / 2;",
            "        const real shift = (s == 0 ? 0.0 : s == 3 ? 0.5 : 0.25) * step;",
            "        const real px = x + shift * a, py = y + shift * b;",
            *flow,
            "        const real weight = s == 1 || s == 2 ? 2 : 1;",
            "        sum_a += weight * u; sum_b += weight * v; a = u; b = v;",
            "        }",
            "        x += 0.5 * step * (1.0 / 6.0) * sum_a; y += 0.5 * step * (1.0 / 6.0) * sum_b;",
            "    }",
            *self._each(
                lambda q, x: (
                    f"worst = fmax(worst, fabs(d{q} + ({x} - {x}0) * {self._units[q]!r} - "
                    f"new_[o + {q} * size_]));"
                )
            ),
            "    if (worst < 1e30) atomicMax(error, __float_as_int((float)worst));",
        ]
        return self._text(["int* error", *velocity], lines)

    def _each(self, code: Any) -> Iterator[str]:
        return (f"    {code(q, x)}" for q, x in enumerate(self._letters))

    def _text(self, more: list[str], lines: list[str], bounds: str = "") -> str:
        arguments = [
            "const real* old", "real* new_", "unsigned* chosen", *point_of(self._grid)[1],
            "const real step", "const index fresh", *more,
        ]  # fmt: skip
        given = constants_of(size=self._grid.size), self._code, arguments, lines, self._grid
        return kernel_text(*given, self._index, "double", bounds)

    def _place(self) -> list[str]:
        """Code of the displacements d0, d1 of node o, of its place (x0, y0, r), and of where its
        line begins."""
        x, _ = point_of(self._grid)
        names = [
            x[axis] for axis in (*self._moving, *(a for a in range(3) if a not in self._moving))
        ]
        at = "0"
        if self._tables and self._stage.axis is not None:
            row = int(self._flow.sizes[2])
            block = self._grid.nodes[self._stage.axis] * row
            at = f"o / (index){block} * (index){self._flow.count} + o % (index){row}"
        lines = [
            f"    const index at = {at};",
            f"    const real r = {names[2]};",
            *self._each(lambda q, x: f"const real d{q} = fresh ? 0 : old[o + {q} * size_];"),
            *self._each(
                lambda q, x: f"const real {x}0 = {names[q]} + d{q} * {1 / self._units[q]!r};"
            ),
        ]
        return lines if len(self._moving) == 2 else [*lines, f"    const real y0 = {names[1]};"]

    def _walls(self) -> tuple[str, str]:
        """Conditions that a path is beyond walls, and that it ends inside and is finite."""
        bounds, walls, inside = self._moved.bounds(self._flow), ["false"], []
        for q, (axis, x) in enumerate(zip(self._moving, self._letters, strict=True)):
            low, high = (repr(float(bound)) for bound in bounds[2 * q : 2 * q + 2])
            if self._grid.periodic[axis]:
                far = FEET.cells / self._units[q]
                inside.append(f"fabs({'ab'[q]}) <= {far!r}")
            else:
                walls.append(f"{x} < {low} || {x} > {high}")
                inside.append(f"{x} >= {low} && {x} <= {high}")
        return " || ".join(walls), " && ".join(inside)


# The backward velocity at a point, as `displacement_loops` has it for a block of nodes.
_FLOW = "def flow({}: Real, {}: Real, {}: Real, at: Index, box: Array) -> tuple[Real, Real]:"


def _formula_source(flow: Any, moving: Sequence[int]) -> str:
    outputs = {f"o{q}": rate for q, rate in enumerate(flow.rates)}
    lines = [
        _FLOW.format(*coordinates(moving)),
        *(f"    b{q} = box[{q}]" for q in range(len(flow.held))),
        *statements(outputs),
        f"    return o0, {'o1' if len(outputs) > 1 else '0.0'}",
    ]
    return "\n".join([*lines, ""])


def _spline_source(flow: Any, degree: int, axes: int) -> str:
    """Of uniform B-splines on lines, or in planes with components one after the other."""
    terms, row = range(degree + 1), int(flow.sizes[2 * axes])
    lines = [_FLOW.format(*"pqr")]
    for axis, place in enumerate("pq"[:axes]):
        n, periodic = map(int, flow.sizes[2 * axis : 2 * axis + 2])
        inside = [f"k{axis} = k{axis} % {n}"]
        if not periodic:
            inside = [
                f"k{axis} = min(max(k{axis}, 0), {n - 1})",
                f"s{axis} = {place} - k{axis}",
            ]
        lines += [
            f"    k{axis} = floor({place})",
            f"    s{axis} = {place} - k{axis}",
            f"    if k{axis} < 0 or k{axis} >= {n}:",
            *(f"        {line}" for line in inside),
            *(f"    w{axis}_{j} = {code}" for j, code in enumerate(weights_of(degree, f"s{axis}"))),
        ]
    if axes == 1:
        total = " + ".join(f"w0_{j} * box[first + {j * row}]" for j in terms)
        lines += [f"    first = at + k0 * {row}", f"    return -({total}), 0.0"]
        return "\n".join([*lines, ""])
    row //= 2  # without the other component
    lines.append(f"    first = k0 * {row} + k1")
    for c in range(2):
        parts = [
            " + ".join(f"w1_{j} * box[first + {c * flow.count + i * row + j}]" for j in terms)
            for i in terms
        ]
        total = " + ".join(f"w0_{i} * ({part})" for i, part in enumerate(parts))
        lines.append(f"    o{c} = {total}")
    return "\n".join([*lines, "    return -o0, -o1", ""])


def combine_source(count: int) -> str:
    """CUDA C of ``run(one, other, tables.., size, weights..)``: sums of arrays with two sets of
    weights; those of weight zero are not read."""
    terms = [
        f"    if (w{q} != 0 || w{count + q} != 0) {{ const double x = t{q}[o]; a += w{q} * x; "
        f"b += w{count + q} * x; }}"
        for q in range(count)
    ]
    arguments = [
        "double* __restrict__ one", "double* __restrict__ other",
        *_scalars("t", count, "const double* __restrict__"), "const long long size",
        *_scalars("w", 2 * count, "const double"),
    ]  # fmt: skip
    lines = [
        f'extern "C" __global__ void run({", ".join(arguments)}) {{',
        "    const long long o = blockIdx.x * (long long)blockDim.x + threadIdx.x;",
        "    if (o >= size) return;",
        "    double a = 0, b = 0;",
        *terms,
        "    one[o] = a; other[o] = b;",
        "}",
    ]
    return "\n".join([*lines, ""])


def difference_source(index: str) -> str:
    """CUDA C of ``run(a, out, said, size, n, stride, periodic, factor, plus, most)``, which writes
    ``plus + factor`` times the difference along lines, NaN beside walls and where it changes by
    more than `most` from that of order 6."""
    arguments = [
        "const double* __restrict__ a", "double* __restrict__ out", "int* said",
        *(f"const index {name}" for name in ("size", "n", "stride", "periodic")),
        *(f"const double {name}" for name in ("factor", "plus", "most")),
    ]  # fmt: skip
    return (
        f"#define DEVICE static __device__ __forceinline__\ntypedef {index} index;\n{_SLOPE}"
        f'extern "C" __global__ void run({", ".join(arguments)}) {{'
        + """
    const index o = blockIdx.x * (index)blockDim.x + threadIdx.x;
    if (o >= size) return;
    const index i = o / stride % n;
    const bool inside = i >= 4 && i < n - 4;
    double more = 0, near[9] = {};
    for (int q = 0; q < 9; q++) {
        const index k = inside ? q - 4 : (i + q - 4 + 4 * n) % n - i;
        if (inside || periodic) near[q] = a[o + k * stride];
    }
    const double value = slope(near + 4, 1, &more);
    const bool good = (periodic || inside) && fabs(more) <= most;
    out[o] = good ? plus + factor * value : nan("");
    if (!good) *said = 1;
}
"""
    )


def update_source(
    moved: Any, name: str, limiter: int, real: str, index: str, fields: int = 1
) -> str:
    """CUDA C of the kernel ``run(m, out, d, said)`` that differences displacements and updates
    `fields` of a periodic plane by the node function `name`; `limiter` from `LIMITER_CODES`."""
    stage, grid = moved.stage, moved.grid
    (nx, ny), (rows, columns), step = grid.nodes, TILE, len(moments(stage.profile, 2))
    body = [
        "    const index size = size_, nx = nx_, ny = ny_;",
        f"    const index i0 = blockIdx.y * {rows}, j0 = blockIdx.x * {columns};",
        "    const index i = i0 + threadIdx.y, j = j0 + threadIdx.x, o = i * ny + j;",
        "    real room[8];",
        *_differences(moved),
        "    if (bad) *said = 1;",
        "    if (i >= nx || j >= ny) return;",
        *widths_of(grid)[0],
        "    const Line x = {h0, 0, ny, nx, 1}, y = {h1, 0, 1, ny, 1};",
        "    const Update update = {size, 2, 0, 0, 0};",
        f"    const Limits limits = {{{limiter}, 0, 0, 0}};",
        "    const Foot foot = {room, 1, 0};",
        *for_fields(f"{name}(m, out, foot, x, y, update, o, i, j, limits);", step, fields),
    ]
    arguments = [
        "const real* __restrict__ m", "real* __restrict__ out", "const double* __restrict__ d",
        "int* said",
    ]  # fmt: skip
    sizes, code = constants_of(size=grid.size, nx_=nx, ny_=ny), translate(modules_of(stage), name)
    blocks = 4 if (step, real) == (4, "double") else BLOCKS
    given = sizes, _SLOPE + code, arguments, body, grid, index, real
    return kernel_text(*given, f"__launch_bounds__({rows * columns}, {blocks}) ")


def _differences(moved: Any) -> list[str]:
    """Code that writes the foot of a node to `room`, and to `bad` whether the tile has a difference
    that changes by too much from that of order 6."""
    rows, columns = TILE
    wide, high, threads, h = columns + 8, rows + 8, rows * columns, moved.grid.spacing
    lane = f"threadIdx.y * {columns} + threadIdx.x"

    def bad(component: int, axis: int) -> str:
        return f"    bad = bad || !(fabs(more) <= {moved.most(component, axis)!r});"

    lines = [
        f"    __shared__ double tile[2][{high * wide}], along[2][{rows * wide}];",
        "    double more;",
        "    bool bad = false;",
        f"    for (int q = {lane}; q < {high * wide}; q += {threads}) {{",
        f"        index k = i0 + q / {wide} - 4, l = j0 + q % {wide} - 4;",
        "        k = k < 0 ? k + nx : k >= nx ? k - nx : k;",
        "        l = l < 0 ? l + ny : l >= ny ? l - ny : l;",
        "        tile[0][q] = d[k * ny + l];",
        "        tile[1][q] = d[size + k * ny + l];",
        "    }",
        "    __syncthreads();",
        f"    for (int q = {lane}; q < {rows * wide}; q += {threads}) {{",
    ]
    for c in (0, 1):
        lines += [
            f"    along[{c}][q] = slope(tile[{c}] + q + {4 * wide}, {wide}, &more);",
            bad(c, 0),
        ]
    lines += [
        "    }",
        "    __syncthreads();",
        f"    const int here = threadIdx.y * {wide} + threadIdx.x + 4, there = here + {4 * wide};",
    ]
    for c in (0, 1):
        x, y = (h[c] / h[axis] for axis in (0, 1))
        lines += [
            f"    room[{c}] = (real)tile[{c}][there];",
            f"    room[{2 + 2 * c}] = (real)({1.0 - c!r} + {x!r} * along[{c}][here]);",
            f"    room[{3 + 2 * c}] = (real)({float(c)!r} + {y!r} * "
            f"slope(tile[{c}] + there, 1, &more));",
            bad(c, 1),
        ]
        if len(moved.stage.jets) > 6:
            lines += [
                f"    room[{6 + c}] = (real)({x / h[1]!r} * slope(along[{c}] + here, 1, &more));",
                bad(c, 0),
            ]
    return lines
