"""Contact rows as arrays of a file."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from scipy import sparse

from contact.result.stored_pieces import on_all_processes
from contact.rows.contact_rows import ContactRows

OWN = "rows/own"  # in a step of a history: it has rows of its own
_SPARSE = ("G", "T")
_OPTIONAL = ("bonded", "owner", "axes")  # rows of files from before there were ties, or two bodies


def rows_arrays(body: Any, rows: ContactRows) -> dict[str, Any]:
    """The arrays of contact rows, but for the gap, which is one of a state."""
    arrays: dict[str, Any] = {}
    for field in fields(ContactRows):
        value = getattr(rows, field.name)
        if field.name in _SPARSE:
            pack(arrays, f"rows/{field.name}", on_all_processes(body, value))
        elif field.name in _OPTIONAL and not value.size:
            continue
        elif field.name not in ("functional", "gap"):
            arrays[f"rows/{field.name}"] = value
    return arrays


def rows_from(arrays: dict[str, Any], functional: str) -> ContactRows:
    """The rows that `rows_arrays` made arrays of, with the gap beside them."""
    parts: dict[str, Any] = {
        field.name: unpack(arrays, f"rows/{field.name}")
        if field.name in _SPARSE
        else arrays[f"rows/{field.name}"]
        for field in fields(ContactRows)
        if field.name != "functional"
        and (field.name not in _OPTIONAL or f"rows/{field.name}" in arrays)
    }
    return ContactRows(**parts, functional=functional)


def pack(arrays: dict[str, Any], name: str, matrix: sparse.csr_array) -> None:
    """Add a sparse matrix to arrays."""
    arrays |= {
        f"{name}/data": matrix.data,
        f"{name}/indices": matrix.indices,
        f"{name}/indptr": matrix.indptr,
        f"{name}/shape": np.array(matrix.shape),
    }


def unpack(arrays: dict[str, Any], name: str) -> sparse.csr_array:
    """A sparse matrix from its arrays."""
    parts = tuple(arrays[f"{name}/{part}"] for part in ("data", "indices", "indptr"))
    matrix = sparse.csr_array(parts, shape=tuple(arrays[f"{name}/shape"].tolist()))
    matrix.check_format(full_check=True)  # products trust the indices
    return matrix
