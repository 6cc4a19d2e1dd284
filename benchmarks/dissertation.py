"""The numbers that S. A. King's dissertation (2012) prints, and the pages of its lists.

Those of Tables 2.1 to 2.3 and 5.1 to 5.3 stand in the examples that repeat them, those of Tables
6.1 and 6.2 beside the measurements in results/*.json.
"""

# Every table, figure and algorithm, in the order of the text, with its page or section.
PLACES = {
    "Figure 2.1": "page 7",
    "Figure 2.2": "page 16",
    "Figure 2.3": "page 16",
    "Table 2.1": "page 16",
    "Figure 2.4": "page 17",
    "Figure 2.5": "page 17",
    "Table 2.2": "page 17",
    "Figure 2.6": "page 18",
    "Figure 2.7": "page 19",
    "Table 2.3": "page 19",
    "Figure 3.1": "page 22",
    "Figure 3.2": "page 32",
    "Figure 3.3": "page 33",
    "Algorithm 1": "section 4.3.3",
    "Figure 5.1": "page 47",
    "Figure 5.2": "page 48",
    "Algorithm 2": "section 5.1.1",
    "Table 5.1": "page 50",
    "Table 5.2": "page 51",
    "Figure 5.3": "page 52",
    "Table 5.3": "page 52",
    "Figure 5.4": "page 53",
    "Table 5.4": "page 55",
    "Figure 5.5": "page 56",
    "Algorithm 3": "section 5.2",
    "Figure 5.6": "page 57",
    "Algorithm 4": "section 6.1.1",
    "Figure 6.1": "page 63",
    "Algorithm 5": "section 6.2",
    "Algorithm 6": "section 6.2",
    "Table 6.1": "page 66",
    "Table 6.2": "page 69",
    "Algorithm 7": "section 6.3",
    "Figure A.1": "page 77",
}

# Index of the Bessel function and number of its root, the exact value, and the errors on n x n
# cells for n = 4, 8, 16, 32, 64.
TABLE_5_4 = (
    ((0, 1), 34.2360, (1.167e-1, 3.690e-2, 3.378e-3, 4.835e-3, 7.966e-4)),
    ((1, 1), 86.9162, (1.251e-1, 7.023e-3, 9.053e-3, 1.251e-2, 4.417e-3)),
    ((1, 1), 86.9162, (1.118e-1, 6.005e-2, 1.458e-2, 2.618e-3, 2.766e-3)),
    ((2, 1), 156.136, (1.488e-1, 1.399e-2, 7.594e-3, 1.434e-2, 3.994e-3)),
    ((2, 1), 156.136, (1.012e-1, 4.527e-2, 1.032e-2, 3.675e-3, 2.131e-3)),
    ((0, 2), 180.388, (9.233e-2, 3.443e-2, 3.336e-3, 4.394e-3, 7.180e-4)),
    ((3, 1), 240.979, (1.845e-1, 1.431e-2, 5.664e-3, 7.926e-3, 2.144e-3)),
    ((3, 1), 240.979, (6.987e-2, 5.016e-2, 7.297e-3, 3.284e-3, 2.107e-4)),
    ((1, 2), 291.370, (7.311e-2, 8.801e-3, 9.370e-3, 1.199e-2, 4.427e-3)),
    ((1, 2), 291.370, (3.204e-2, 4.849e-2, 1.266e-3, 2.946e-3, 2.796e-3)),
)
FIGURE_2_5_ORDER = 4.0  # of the cubic profile, section 2.4
FIGURE_3_2_ERROR = 0.0035  # at t = 1.2, section 3.3
FIGURE_3_3_ERROR = 0.0048  # of the slice, section 3.3
FIGURE_5_2_ENTRIES = 27  # nine vertices with three dofs
FIGURE_5_3_ORDERS = {"Neumann": 5.0, "Dirichlet": 4.0, "elastic": 5.0}  # "better than"
FIGURE_6_1_SPEEDUP = 3.0  # at n = 6400, section 6.1.1
CONTACT_STEPS = 10  # fewer, to three digits, section 5.2
