"""The corrector's tolerance bounds what it says: the distance of each point of a branch from the curve."""

import numpy as np
import pytest

import hbnlp
from hbnlp.continuation.newton import correct

SYSTEMS = {
    "duffing": (hbnlp.systems.duffing(), (0.5, 1.6)),
    "chain": (hbnlp.systems.chain(4), (0.1, 2.2)),
    "absorber": (hbnlp.systems.tuned_absorber(force=0.15), (0.8, 2.6)),
}


def distances(branch: hbnlp.Branch) -> np.ndarray:
    """Return how far each point is from the curve, by a Newton of its own, relative to solution and parameter."""
    problem = branch.problem
    assembly, index = problem.assembly, problem.system.parameters.index(branch.name)
    found = []
    for i in range(1, len(branch) - 1):
        first = np.append(branch.coefficients[i].ravel(), branch.parameter[i])
        sizes = np.append(np.full(first.size - 1, np.linalg.norm(first[:-1])), abs(first[-1]))
        values, y, row = problem.values(branch.solution(i).parameters), first.copy(), None
        for _ in range(5):
            values[index] = y[-1]
            x = y[:-1]
            jacobian = sizes * np.column_stack(
                [assembly.jacobian(x, values), assembly.parameter_derivative(x, values, index)]
            )
            row = np.linalg.svd(jacobian)[2][-1] if row is None else row
            right = np.append(assembly.residual(x, values), 0.0)
            y = y - sizes * np.linalg.solve(np.vstack([jacobian, row]), right)
        found.append(np.linalg.norm((y - first) / sizes))
    return np.array(found)


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("tol", [1e-6, 1e-10])
def test_no_point_of_a_branch_is_farther_from_the_curve_than_the_tolerance(name, tol):
    system, span = SYSTEMS[name]
    method = hbnlp.PseudoArclength(newton=hbnlp.Newton(tol=tol, max_iterations=8))
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 5), "omega", span, stability=None, method=method)
    assert branch.end is hbnlp.End.SPAN_END
    assert distances(branch).max() <= 1.5 * tol  # another plane and metric than the corrector's


@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("omega", [0.7, 1.0, 1.2])
def test_a_solution_is_as_near_as_the_tolerance(omega, tol):
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 7)
    exact = hbnlp.solve(problem, at={"omega": omega}, method=hbnlp.Newton(tol=1e-14, max_iterations=50))
    found = hbnlp.solve(problem, at={"omega": omega}, method=hbnlp.Newton(tol=tol))
    error = np.linalg.norm(found.coefficients - exact.coefficients) / np.linalg.norm(exact.coefficients)
    assert error <= tol + 1e-14


class Noisy:
    """x = p, with a residual that is known to a part of it only."""

    size = 1
    parts = None

    def __init__(self, noise):
        self.noise = noise

    def residual(self, y):
        return np.array([y[0] - y[1] + self.noise * np.sin(1e12 * y[0])])

    def jacobian(self, _y, out):
        out[0] = 1.0, -1.0

    def scale(self, y):
        return np.full(2, np.abs(y).max())

    def term_size(self, y):
        return float(np.abs(y).max())


@pytest.mark.parametrize(("noise", "converged"), [(0.0, True), (2e-9, True), (1e-5, False)])
@pytest.mark.parametrize("start", [0.3, 0.69, 1.1])
def test_steps_that_no_longer_shrink_are_round_off_if_they_are_small(noise, converged, start):
    """A fold curve of the wing ended where round-off left 1e-9."""
    found = correct(Noisy(noise), np.array([start, 0.7]), np.array([0.0, 1.0]), hbnlp.Newton(tol=1e-12))
    assert found.converged is converged
    if converged:
        assert abs(found.y[0] - 0.7) <= max(1e-12, 2.0 * noise)
