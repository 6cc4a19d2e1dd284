"""Fast assembly where many cells are congruent.

In: a form of scikit-fem, a mesh or Basis, an element.
Out: a CSR matrix or a vector: a local matrix for each class of cells, scattered by compiled loops.
Start: `assemble`, then `congruence_classes`, `local_tensors`, `csr_scatter`.
"""
