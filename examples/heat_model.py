r"""The controlled heat equation of the dissertation's section 6.2.1, by modes.

On (0, 1)^d with d = 2 or 3, heated through the two sides z = 0 and z = 1 of the last axis,

    y_t = lap y,   y_n = b u_1 on z = 0,   y_n = b u_2 on z = 1,   y_n = 0 elsewhere,

b the indicator of 0.3 < x < 0.77 in the other directions, to minimise the integral over all time of
|y|^2 + |u_1|^2 + |u_2|^2. With phi_0 = 1, phi_k = sqrt(2) cos(k pi x), which are orthonormal, the
modes obey y' = A y + B u with

    A = -pi^2 diag(k^2 + l^2 + m^2),   B = c_k c_l phi_m(0) and c_k c_l phi_m(1),

c_k the integral of phi_k over (0.3, 0.77), and the weight is the identity. The dissertation's
(6.11) has one pi^2 too many and leaves out that its cosines are not normalised. The constant mode
has the eigenvalue 0: A is singular. Run by itself the script draws the square heated from z = 0.

    python examples/heat_model.py [--output out]
"""

import argparse
from pathlib import Path

import numpy as np

PATCH = (0.3, 0.77)


def heat_modes(N, dim=3):
    """Return the diagonal of A, shape (N**dim,), and B, shape (N**dim, 2)."""
    k = np.arange(N)
    norm = np.where(k > 0, np.sqrt(2), 1.0)
    wave = np.pi * np.maximum(k, 1)
    c = np.where(
        k > 0, norm * (np.sin(PATCH[1] * wave) - np.sin(PATCH[0] * wave)) / wave, np.ptp(PATCH)
    )
    axes = np.meshgrid(*[k] * dim, indexing="ij")
    A = -(np.pi**2) * sum(i.astype(float) ** 2 for i in axes).ravel()
    near = norm[axes[-1]]
    for i in axes[:-1]:
        near = near * c[i]
    return A, np.stack([near.ravel(), (near * (-1.0) ** axes[-1]).ravel()], axis=1)


def main(argv=None):
    """Draw the temperature of the square while u_1 = 1 and u_2 = 0, from y = 0 on."""
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    output = parser.parse_args(argv).output
    N, s, times = 40, np.linspace(0, 1, 101), (0.02, 0.1, 0.5)
    A, B = heat_modes(N, dim=2)
    phi = np.cos(np.pi * np.outer(s, np.arange(N))) * np.where(np.arange(N) > 0, np.sqrt(2), 1.0)
    # y' = A y + B u with constant u: (exp(A t) - 1) / A times B u, or t B u where A = 0.
    still = A == 0
    rate = np.where(still, -1.0, A)
    fields = [np.where(still, t, np.expm1(rate * t) / rate) * B[:, 0] for t in times]
    fields = [phi @ modes.reshape(N, N) @ phi.T for modes in fields]
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    axes = figure.subplots(1, len(times), sharey=True)
    for ax, t, y in zip(axes, times, fields, strict=True):
        drawn = ax.pcolormesh(
            s, s, y.T, vmin=0, vmax=np.max(fields), shading="gouraud", cmap="inferno"
        )
        ax.plot(PATCH, (0, 0), "C0", lw=5, clip_on=False, label="heated", solid_capstyle="butt")
        ax.set(title=f"time {t:g}, mean {np.ptp(PATCH) * t:.3f}", aspect="equal", xlabel="x")
    axes[0].set_ylabel("z")
    axes[0].legend()
    figure.colorbar(drawn, ax=axes, label="temperature y, arbitrary units")
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "heat_model.png", dpi=120)


if __name__ == "__main__":
    main()
