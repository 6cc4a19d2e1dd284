"""Domains whose boundary cuts the cells of a mesh of rectangles.

In: a mesh and a level set or polygon.
Out: `CutDomain` with its bases, the extension from cells inside, Nitsche and ghost penalty terms.
Start: `cut_domain`, then `adini_extension` and `nitsche`; rules are made in `quadrature`.
"""
