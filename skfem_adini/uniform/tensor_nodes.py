"""Where the vertices of scikit-fem's tensor meshes lie in a grid."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def tensor_nodes(grid: Sequence[int]) -> NDArray[np.intp]:
    """Return the vertex numbers of `init_tensor` as an array over the grid, of shape `grid`."""
    if len(grid) == 2:
        return np.arange(np.prod(grid)).reshape(grid)
    x, y, z = grid
    return np.arange(np.prod(grid)).reshape(z, x, y).transpose(1, 2, 0).copy()
