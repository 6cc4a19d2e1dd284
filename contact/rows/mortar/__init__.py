"""The interface of two deformable bodies whose meshes do not match: mortar contact rows.

In: contact facets of two bodies, the first of which carries the multipliers (the non-mortar side).
Out: rows G and T of the first body with the columns of both; weights, places, frames, gap.
Start: `Interface` in `mortar_rows`; charts, `FacetCurves` or `FaceMaps`, know the facets.
"""
