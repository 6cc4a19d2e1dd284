"""The mesh of periodic layers, for the same body on the sparse path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.layers.layers import Layer


def meshed(
    kind: Any, lengths: Sequence[float], shape: Sequence[int], layers: Sequence[Layer]
) -> tuple[Any, NDArray[np.int64]]:
    """Tensor mesh with the boundaries "bottom", "top", "low 0", "high 0", ..., and cells' layers.

    Parameters
    ----------
    kind : type
        MeshQuad or MeshHex.
    lengths : sequence of float
    shape : sequence of int
        Cells in the lateral directions.
    layers : sequence of Layer
    """
    dim = len(lengths) + 1
    ticks = [np.linspace(0, length, n + 1) for length, n in zip(lengths, shape, strict=True)]
    levels = np.concatenate(
        [
            np.linspace(layer.bottom, layer.bottom + layer.height, layer.cells + 1)[k > 0 :]
            for k, layer in enumerate(layers)
        ]
    )
    mesh = kind.init_tensor(*ticks, levels)
    ends = {"bottom": (dim - 1, 0.0), "top": (dim - 1, levels[-1])}
    for axis, length in enumerate(lengths):
        ends |= {f"low {axis}": (axis, 0.0), f"high {axis}": (axis, length)}
    size = max(*lengths, levels[-1])
    mesh = mesh.with_boundaries(
        {
            name: lambda x, axis=axis, at=at: np.abs(x[axis] - at) < 1e-9 * size
            for name, (axis, at) in ends.items()
        }
    )
    middle = mesh.p[-1][mesh.t].mean(axis=0)
    tops = [layer.bottom + layer.height for layer in layers[:-1]]
    return mesh, np.searchsorted(tops, middle)
