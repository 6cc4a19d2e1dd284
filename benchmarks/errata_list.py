"""The errata that docs/reproduction.md lists: where, what is printed, what is right, the check.

The check is the name of a function of `errata.py`, or empty where reading the formula suffices.
"""

ERRATA = (
    ("2.2, text at (2.8)", "derivatives are scaled by c(y)/c(x)", "where c has a zero this is "
     "0/0; the derivative of the map of feet is integrated with the feet", ""),
    ("(2.13)", "first exponent integrates over x; the kernel runs from -s to 0", "over t; from s "
     "to 0, with s between -dt and 0", "duhamel"),
    ("2.3, step 1", "the characteristic passes x_k at the time dt", "at the time 0, and y_k at "
     "-dt, as in (2.4)", ""),
    ("2.3, linear profile", "a constant a0 + a1, evaluated at y_k", "a0 + a1 x, evaluated at y_j",
     ""),
    ("(2.17)", "the left tangent is taken about the right node and the other way round", "about "
     "their own nodes: x + h/2 on the left, x - h/2 on the right", "tangents"),
    ("(2.17), x*", "divided by twice the difference of the values", "by twice the difference of "
     "the slopes, and only where it lies in the cell", "crossing"),
    ("(2.18)", "concave data get the larger of the two tangents", "the smaller one, convex data "
     "the larger one", "branches"),
    ("(2.18)", "the weights' width 1e-6 is compared with differences of values and with slopes "
     "alike", "a width without units, or the sharp choice; row *smoothed* of Table 2.1 has the "
     "printed width", ""),
    ("(2.21)", "the slope of node k + 1, and a difference of the two fractions", "that of node k "
     "- 1, and their sum", ""),
    ("(2.23)", "differences of the two slopes", "their sums, as in (2.22)", "cubic_derivative"),
    ("2.4, example 1", "the solution is said to be that of (2.29), for all x", "of (2.28), and "
     "zero where |x| > (1 - exp(-2t))^(-1/2): there the formula is too large by",
     "example_1_outside"),
    ("2.4, example 2", "the printed solution", "it has the wrong sign for x > 0; right is "
     "exp(-10 X^2) exp(-t) d^(-3/2), d = 1 - x^2 + x^2 exp(-2t), X = x exp(-t) d^(-1/2)",
     "example_2_solution"),
    ("2.4, example 2", "a solution that is not smooth explains the low order", "the solution is "
     "smooth for all t; the cubic tends to order 3 (Table 2.3)", ""),
    ("2.4, end", "a piecewise cubic profile", "the piecewise linear one", ""),
    ("(3.8)", "u_x2 is differentiated by t beside the speed of x1", "by x1", ""),
    ("(3.14)", "p is multiplied by y3", "divided by y3, which (3.13) gives at -dt",
     "advection_factor"),
    ("before and in (3.18)", "the fundamental solution acts on (1, W1, W2), and X3(0) is not "
     "given", "on (P(0), W1, W2); X3(0) = 1", ""),
    ("after (3.24)", "the trapezoidal rule starts from the value at x1", "from the value at the "
     "foot y1", ""),
    ("after (3.25)", "x2 moves with a", "with b", ""),
    ("(3.26)", "the derivative is read at x2", "at y2", ""),
    ("(3.30)", "the new value stands at the time t", "at t + dt", ""),
    ("(3.31), (3.32)", "one symbol for both derivatives of the profile", "the derivative by x1 "
     "first, by x2 second", ""),
    ("3.3, example 1", "splitting needs the CFL condition", "it does not: Figure 3.2 with "
     "twice the step", ""),
    ("3.3, example 2", "a mesh width of .01", ".04: 100 cells on a side of length 4, where x = "
     "-.84 is a node", ""),
    ("(4.2)", "the normal component of the stress is not negative in contact", "the pressure is "
     "not negative; it is minus that component", ""),
    ("(4.3)", "the tangential stress is multiplied by u", "u does not belong there", ""),
    ("after (4.6)", "the first row of the stress is (s11, s22)", "(s11, s12)", ""),
    ("4.2.1", "the multiplier enters the optimality condition with a minus, the body force is "
     "missing", "with a plus, and minus the work of f", ""),
    ("4.2.2", "the friction enters with a minus; |s_t| <= F |s_t|", "with a plus; |s_t| <= F "
     "|s_n|", ""),
    ("after (4.11)", "|lambda u| = |u| max(0, |u| - eps)", "|u| min(1, |u| / eps)",
     "smoothed_product"),
    ("proof of Theorem 1", "lambda (u+ - u) is at most the rise of psi", "at least, with |u+ - "
     "u|^2 / (2 max(eps, |u|)) to spare; from this the energy falls. Share of pairs that violate "
     "it", "descent"),
    ("4.3.1, psi''", "zero for |s| > eps", "only for scalars; (I - s s^T/|s|^2) / |s| for "
     "vectors", "second_derivative"),
    ("4.3.1, step 3", "(4.16) holds where |lambda + c u| <= 1 and u = 0 elsewhere", "the other "
     "way round: d - 1 is a divisor in (4.16), and points at the bound slip", ""),
    ("(4.15), (5.3), Algorithms 1 and 3", "the lesser of eps and |u|, of |lambda| and 1", "the "
     "greater one, as in (4.12)", ""),
    ("5.1.1, energy", "mixed terms mu u1_y u2_x + lambda u1_x u2_y", "twice as much; a rotation "
     "then has no energy", "rotation_energy"),
    ("5.1.1, (5.1)", "u_x stands where the value belongs at three vertices", "the value", ""),
    ("5.1.1", "the shape functions are C1", "they are continuous with their tangential "
     "derivative; the normal one jumps. Largest jump for random dofs, and that of the values",
     "smoothness"),
    ("5.1.1, friction integral", "a sum without weights", "with the weights h/8 (1, 3, 3, 1) of "
     "a cell; in Algorithm 3 the forces mu bring them", "friction_weights"),
    ("(5.2), (5.3)", "f is missing on the right, u after S", "S u + G^T mu = f, and the same "
     "with the springs", ""),
    ("after (5.5)", "Q u = lambda H u", "H u = lambda Q u", ""),
    ("5.1.2", "better than fifth and fourth order", "sixth in both (Figure 5.3); the last "
     "columns of Tables 5.1 and 5.2 hold rounding errors", ""),
    ("5.1.3", "two vertices inside determine a cubic with four points of the curve", "not where "
     "the curve is straight, and badly where it is nearly so (Figure 5.4)", ""),
    ("(5.6)", "r is measured from the origin; a Neumann condition is named", "from (.5, .5); "
     "Table 5.4 is of the Dirichlet problem", ""),
    ("6.1, SQP", "the model of J begins with its derivative", "with its value", ""),
    ("(6.2)", "plus b x", "minus, as from (6.3) on", ""),
    ("(6.3)", "the active rows are those with Gx > b", "Gx > g; beside max(0, .) they need not "
     "be named", ""),
    ("after (6.3), Algorithm 4", "b is missing in the equation of x", "A x + E^T lambda + G^T mu "
     "= b", ""),
    ("(6.4)", "(Gx - g) g = 0", "(Gx - g) mu = 0", ""),
    ("6.1.1, two-sided bounds", "-x <= phi", "-x <= -phi", ""),
    ("Algorithm 5, step 3", "(V^T V)^-1", "(V^* V)^-1 for complex eigenvectors, or a real basis "
     "of their space", "complex_basis"),
    ("Algorithm 6", "after the shifts the residual f is left as it is", "f becomes v_{k+1} "
     "H_{k+1,k} + f q_k, for which q was formed", "restart_residual"),
    ("(6.11)", "pi^2 twice", "once", "heat_rate"),
    ("(6.11)", "the cosines are taken as orthonormal", "cos(k pi x) has the square norm 1/2 for "
     "k > 0", ""),
    ("6.2.1, weak form", "gradients are integrated over the boundary", "over the domain", ""),
    ("6.2.1, inverse of H", "p is used and not defined, and A is inverted", "p is s; A of this "
     "example is singular (the constant mode), so a feedback moves that mode first", ""),
    ("after (6.13)", "the noise is r in the formula, v in the text", "one of them", ""),
    ("after (6.18)", "P^b = M [M0 P0 M0^T + Q] M^T", "plus Q, the noise of the last step",
     "forecast_covariance"),
    ("A.0.2", "blocks of 7 threads", "multiples of 32, as the same section says", ""),
    ("A.0.3", "Q^T is applied from the right", "from the left: f is one column", ""),
)  # fmt: skip
