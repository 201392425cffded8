"""Derivatives along a direction in which a parameter without a component plays no part."""

from __future__ import annotations

import casadi as ca


def slope_along(
    expression: ca.SX, p: ca.SX, dp: ca.SX, others: ca.SX | None = None, along: ca.SX | None = None
) -> ca.SX:
    """Return the dense derivative of an expression by parameters p along dp, and by other symbols along ``along``.

    At the edge of its domain a derivative by a parameter is infinite (of sqrt(p) at zero): times a component that is
    zero it would be none at all, and with it the derivatives by all others.
    """
    slope = ca.jtimes(expression, others, along) if others is not None else ca.SX(*expression.shape)
    for i in range(p.numel()):
        if ca.depends_on(expression, p[i]):
            slope += ca.if_else(dp[i] != 0.0, ca.jtimes(expression, p[i], dp[i]), 0.0)
    return ca.densify(slope)
