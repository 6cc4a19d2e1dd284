"""The bottom row of cells of a layered block, which carries the contact boundary."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from contact.errors import InputError


class LowestRow(ElasticBody):
    """The bottom row of cells of a `LayeredBlock`; only its edge "bottom" may be in contact."""

    def whole_facets(self, boundary: Any) -> NDArray[np.int64]:
        """Facets of "bottom", given by name: facet numbers would belong to another mesh."""
        names = [boundary] if isinstance(boundary, str) else boundary
        if not isinstance(names, list | tuple) or any(not isinstance(n, str) for n in names):
            raise InputError(
                f"boundary={boundary!r}: a LayeredBlock meets obstacles on its 'bottom', by that "
                "name; block.elastic() takes facet numbers"
            )
        return super().whole_facets(boundary)
