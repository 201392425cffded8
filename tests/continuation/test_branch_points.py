"""Branch points against closed forms, and branches that lead past them."""

import numpy as np
import pytest

import hbnlp
from hbnlp.continuation.branch_points import Arc, branch_point_on


class Pitchfork:
    """x^3 - (l - 1) x + e = 0, z = l^2: for e = 0 the curve x = 0 is crossed at l = 1 by x^2 = l - 1."""

    size = 2

    def __init__(self, imperfection=0.0):
        self.e = imperfection

    def residual(self, y):
        x, z, l = y
        return np.array([x**3 - (l - 1.0) * x + self.e, z - l**2])

    def jacobian(self, y, out):
        x, _, l = y
        out[:] = [[3.0 * x**2 - (l - 1.0), 0.0, -x], [0.0, 1.0, -2.0 * l]]

    def scale(self, y):
        return np.ones(y.size)

    def term_size(self, _):
        return 1.0


def arc_and_determinants(curve, begin, end):
    points = [np.array([0.0, l**2, l]) for l in (begin, end)]
    tangents = tuple(np.sign(end - begin) * np.array([0.0, 2.0 * l, 1.0]) for l in (begin, end))
    determinants = []
    for y, t in zip(points, tangents, strict=True):
        matrix = np.zeros((3, 3))
        curve.jacobian(y, matrix[:2])
        matrix[2] = t / np.linalg.norm(t)
        determinants.append(float(np.linalg.det(matrix)))
    return Arc(points[0], points[1], tangents, np.ones(3)), tuple(determinants)


@pytest.mark.parametrize(("begin", "end"), [(0.8, 1.1), (1.3, 0.9), (0.999, 1.0005)])
def test_the_crossing_of_a_pitchfork_is_found_exactly(begin, end):
    curve = Pitchfork()
    arc, determinants = arc_and_determinants(curve, begin, end)
    found = branch_point_on(curve, arc, determinants, tol=1e-12, max_iterations=10)
    assert found.y == pytest.approx([0.0, 1.0, 1.0], abs=1e-12)
    # the second direction of the kernel is that of x
    assert abs(found.null) == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("imperfection", [1e-3, 1e-6])
def test_curves_that_pass_each_other_do_not_cross(imperfection):
    curve = Pitchfork(imperfection)
    arc, determinants = arc_and_determinants(curve, 0.8, 1.1)
    assert branch_point_on(curve, arc, determinants, tol=1e-12, max_iterations=10) is None


@pytest.fixture(scope="module")
def wing():
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=10)
    return hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=10))


@pytest.mark.parametrize("angle", [5, 7, 10])
def test_a_wing_is_traced_past_its_branch_points(wing, angle):
    """Correctors fail beside one near omega = 27.43."""
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)
    quiet = hbnlp.solve(problem, at={"omega": 14.0, "pitch_amplitude": np.radians(2.5)})
    branch = hbnlp.trace(
        problem,
        "omega",
        (0.1, 60.0),
        start=quiet,
        direction=-1,
        stability=None,
        method=hbnlp.PseudoArclength(angle=angle),
    )
    assert branch.end is hbnlp.End.SPAN_END
    assert min(abs(point.value - 27.43) for point in branch.branch_points) < 0.05


def test_both_mirror_images_of_an_asymmetric_branch_close_where_it_began():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=4.0), n_harmonics=9)
    symmetric = hbnlp.trace(problem, "omega", (0.3, 4.0), stability=None)
    assert len(symmetric.branch_points) == 4
    for point in symmetric.branch_points:
        starts = hbnlp.switch_branch(point)
        first, second = (hbnlp.trace(s, "omega", (0.3, 4.0), stability=None) for s in starts)
        assert first.end is second.end is hbnlp.End.CLOSED
        assert [f.value for f in first.folds] == pytest.approx([f.value for f in second.folds], rel=1e-9)


class InUnits(Pitchfork):
    """The pitchfork, its equations multiplied by a number whose square is none."""

    def __init__(self, unit):
        super().__init__()
        self.unit = unit

    def residual(self, y):
        return super().residual(y) * self.unit

    def jacobian(self, y, out):
        super().jacobian(y, out)
        out *= self.unit

    def term_size(self, _):
        return self.unit


def test_a_crossing_is_found_where_squares_of_the_solutions_overflow():
    arc, determinants = arc_and_determinants(Pitchfork(), 0.8, 1.1)
    found = branch_point_on(InUnits(1e-120), arc, determinants, tol=1e-12, max_iterations=10)
    assert found.y == pytest.approx([0.0, 1.0, 1.0], abs=1e-12)


@pytest.mark.parametrize("unit", [1e-308, 1e300])
def test_what_is_not_finite_gives_no_branch_point_and_no_warning(unit):
    arc, determinants = arc_and_determinants(Pitchfork(), 0.8, 1.1)
    assert branch_point_on(InUnits(unit), arc, determinants, tol=1e-12, max_iterations=10) is None


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("beside", [0, 1])
def test_a_loop_has_both_its_branch_points_though_one_lies_in_the_step_that_closes_it(beside, direction):
    """The broken symmetry of a Duffing oscillator: begun just past one of the two, the loop closes across it."""
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0), n_harmonics=9)
    symmetric = hbnlp.trace(problem, "omega", (0.6, 1.2), stability=None)
    assert [point.value for point in symmetric.branch_points] == pytest.approx([0.806144, 0.924215], abs=1e-6)
    start = hbnlp.switch_branch(symmetric.branch_points[beside])[0]
    loop = hbnlp.trace(problem, "omega", (0.6, 1.2), start=start, direction=direction, stability=None)
    assert loop.end is hbnlp.End.CLOSED
    assert sorted(point.value for point in loop.branch_points) == pytest.approx([0.806144, 0.924215], abs=1e-6)
    assert loop.folds == ()
