"""Functions that an expression calls and CasADi does not look into: interpolated tables, and others from outside."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import NamedTuple

import casadi as ca

from hbnlp.systems.switches import dependencies, nodes

_ADVICE = {
    "LinearInterpolant": "a ca.interpolant that is 'linear' and so has one at its points: make it a 'bspline'",
    "BSplineInterpolant": "a ca.interpolant that the motion leaves, or of a low degree: widen its grid, or take "
    "degree 3, the default",
}


class Call(NamedTuple):
    """A call in an expression: of what, and with which scalar expressions."""

    function: ca.Function
    arguments: ca.SX

    def slopes(self) -> ca.SX:
        """Return the derivatives of the results by the arguments, in one column."""
        symbols = ca.SX.sym("argument", self.arguments.numel())
        shapes = [self.function.sparsity_in(i) for i in range(self.function.n_in())]
        ends = pairwise(accumulate((shape.nnz() for shape in shapes), initial=0))
        parts = [ca.SX(shape, symbols[a:b]) for shape, (a, b) in zip(shapes, ends, strict=True)]
        results = ca.vertcat(*[ca.vec(result) for result in self.function.call(parts)])
        slopes = ca.vec(ca.densify(ca.jacobian(results, symbols)))
        return ca.substitute(slopes, symbols, self.arguments)

    @property
    def advice(self) -> str:
        """What the function is, and what to do if it is not smooth."""
        return _ADVICE.get(self.function.class_name(), "which the force calls: smooth it there")


def calls(expression: ca.SX) -> list[Call]:
    """Return the calls in an expression, each once."""
    found = [node for node in nodes(expression) if node.op() == ca.OP_CALL]
    return [Call(node.which_function(), ca.vertcat(*dependencies(node))) for node in found]


def check_derivatives(what: str, expression: ca.SX) -> None:
    """Raise a ValueError if an expression calls a function of which there is no derivative."""
    for call in calls(expression):
        try:
            call.slopes()
        except RuntimeError as error:
            raise ValueError(
                f"{what} calls {call.function.name()!r}, which has no derivative; give the ca.Callback a "
                'get_jacobian, or construct it with {"enable_fd": True}'
            ) from error
