"""The diagonal by several threads is that of SciPy."""

import numpy as np
import pytest
from scipy import sparse

from contact.arrays import row_blocks


@pytest.mark.parametrize("entries", [1, 40, 10**9])
@pytest.mark.parametrize("n", [1, 5, 203])
def test_diagonal(monkeypatch, entries, n):
    monkeypatch.setattr(row_blocks, "_OF_A_THREAD", entries)
    monkeypatch.setattr(row_blocks.os, "cpu_count", lambda: 3)
    matrix = sparse.random_array((n, n), density=0.3, rng=np.random.default_rng(n), format="csr")
    matrix = sparse.csr_array(matrix + sparse.diags_array((np.arange(n) % 3).astype(float)))
    np.testing.assert_array_equal(row_blocks.diagonal(matrix), matrix.diagonal())
