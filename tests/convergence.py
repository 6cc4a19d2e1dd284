"""Orders of convergence, for the tests of all packages."""

import numpy as np


def order(cells, errors):
    """Order in h ~ 1 / cells by a least-squares fit of the errors' logarithms."""
    return -np.polyfit(np.log(cells), np.log(errors), 1)[0]
