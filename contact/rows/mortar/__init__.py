"""The interface of two deformable bodies whose meshes do not match: mortar contact rows.

In: contact facets of two bodies, the first of which carries the multipliers (non-mortar side).
Out: rows G and T on the dofs of both bodies; weights, points, frames, gap.
Start: `Interface` in `mortar_rows`; `FacetCurves` and `FaceMaps` describe the facets.
"""
