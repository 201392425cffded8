"""Floquet multipliers: closed forms, Mathieu's characteristic values, and integration by another method."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment, root

from hbnlp.core.errors import NonFiniteError
from hbnlp.fourier import FourierBasis, basis_derivatives
from hbnlp.stability.collocation import Gauss
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import Floquet
from hbnlp.stability.spectra import product, spectrum
from hbnlp.systems.system import System


def largest_error(multipliers, reference):
    """Of the multipliers above 1e-6, paired, relative to max(1, abs(mu))."""
    error = np.abs(np.subtract.outer(multipliers, reference)) / np.maximum(1.0, np.abs(reference))
    error[np.maximum.outer(np.abs(multipliers), np.abs(reference)) < 1e-6] = 0.0
    return error[linear_sum_assignment(error)].max()


def monodromy(system, x, values, *, periods=1, options=None):
    """The analysis of given coefficients, which need not be a solution."""
    return FloquetEvaluator(system, periods, (np.shape(x)[-1] - 1) // 2, options)(x, values)


def integrated(first_order, period):
    """Multipliers from the state matrix A(t) by an explicit Runge-Kutta method of order eight."""
    n = len(first_order(0.0))
    run = solve_ivp(
        lambda t, y: (first_order(t) @ y.reshape(n, n)).ravel(),
        (0.0, period),
        np.eye(n).ravel(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
    )
    return np.linalg.eigvals(run.y[:, -1].reshape(n, n))


def signal(coefficients, omega):
    """q(t) and q'(t) of coefficients by theta = omega t."""
    h = omega * np.arange(1, coefficients.shape[1] // 2 + 1)
    mean, cosines, sines = coefficients[:, 0], coefficients[:, 1::2], coefficients[:, 2::2]

    def q(t):
        return mean + cosines @ np.cos(h * t) + sines @ np.sin(h * t)

    def v(t):
        return sines @ (h * np.cos(h * t)) - cosines @ (h * np.sin(h * t))

    return q, v


def duffing(damping_ratio=0.025, cubic=0.1, force=0.18):
    return System(
        [[1.0]],
        [[2 * damping_ratio]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"cubic": cubic, "force": force, "omega": 1.2},
    )


def duffing_solution(start, n_harmonics=11, omega=1.2, damping_ratio=0.025, cubic=0.1, force=0.18):
    """Coefficients (1, 2H+1) by sampling and projection, from an amplitude and phase of the first harmonic."""
    basis = FourierBasis(n_harmonics, 4 * n_harmonics + 1)
    slope = omega * basis.derivative_sampling
    curve = omega**2 * basis_derivatives(basis.theta, n_harmonics, 2)

    def residual(x):
        q = basis.sampling @ x
        force_now = force * np.cos(basis.theta)
        return basis.projection @ (curve @ x + 2 * damping_ratio * slope @ x + q + cubic * q**3 - force_now)

    first = np.zeros(2 * n_harmonics + 1)
    first[1:3] = start
    found = root(residual, first, tol=1e-14)
    assert np.abs(found.fun).max() < 1e-12
    return found.x[None]


# First harmonics (cos, sin) near the three solutions, their amplitudes with 11 harmonics by the equations above, and
# multipliers by shooting on the equation of motion with DOP853 at tolerances of 1e-12.
DUFFING = {
    "small": ((-0.41, 0.06), 0.4175204536, [0.48848659 + 0.72872921j, 0.48848659 - 0.72872921j]),
    "middle": ((-1.49, 1.7), 2.2605488905, [1.31490727, 0.58533817]),
    "large": ((1.4, 2.08), 2.5091975811, [0.80986415 + 0.33732103j, 0.80986415 - 0.33732103j]),
}


@pytest.fixture(scope="module", params=list(DUFFING))
def duffing_case(request):
    start, amplitude, multipliers = DUFFING[request.param]
    return duffing_solution(start), amplitude, np.array(multipliers)


def van_der_pol_chain():
    """Three coupled masses with damping (q_i^2 - 1) q_i' and forces q_i q_{i+1}: f_q is full and not symmetric."""
    k = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    m = np.diag([1.0, 1.5, 0.8]) + 0.1

    def force(q, v, tau, p):
        return [p.mu * (q[i] ** 2 - 1) * v[i] + 0.3 * q[i] * q[(i + 1) % 3] * (1 + 0.2 * ca.sin(tau)) for i in range(3)]

    def first_order(q, v, tau, mu):
        by_q, by_v = np.zeros((2, 3, 3))
        for i in range(3):
            j = (i + 1) % 3
            by_v[i, i] = mu * (q[i] ** 2 - 1)
            by_q[i, i] = 2 * mu * q[i] * v[i] + 0.3 * q[j] * (1 + 0.2 * np.sin(tau))
            by_q[i, j] = 0.3 * q[i] * (1 + 0.2 * np.sin(tau))
        return np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(m, k + by_q), -np.linalg.solve(m, by_v)]])

    return System(m, np.zeros((3, 3)), k, nonlinear_force=force, parameters={"mu": 0.4, "omega": 1.3}), first_order


def lagged(seed, stiffest):
    """Two cubic oscillators with seven lag states, real poles and pairs, the fastest at -stiffest, A not diagonal."""
    rng = np.random.default_rng(seed)
    a = np.diag([-0.2, -0.7, -3.0, -0.4, -0.4, -30.0, -float(stiffest)])
    a[3, 4], a[4, 3] = 6.0, -6.0
    turn = np.eye(7) + 0.2 * rng.normal(size=(7, 7))
    a = turn @ a @ np.linalg.inv(turn)
    b, output = rng.normal(size=(7, 2)), 0.1 * rng.normal(size=(2, 7))
    m, d, k = np.array([[1.2, 0.3], [0.1, 0.9]]), np.array([[0.1, 0.0], [-0.05, 0.1]]), np.diag([1.0, 40.0])
    system = System(
        m,
        d,
        k,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 + 0.5 * q[0] * q[1] ** 2, q[1] * q[0] ** 2 + 0.2 * v[1] ** 3],
        parameters={"omega": 0.9},
        lag_state=a,
        lag_input=b,
        lag_output=output,
    )

    def first_order(q, v):
        by_q = np.array([[3 * q[0] ** 2 + 0.5 * q[1] ** 2, q[0] * q[1]], [2 * q[0] * q[1], q[0] ** 2]])
        by_v = np.diag([0.0, 0.6 * v[1] ** 2])
        acceleration = np.linalg.solve(m, np.hstack([-(k + by_q), -(d + by_v), output]))
        velocity = np.hstack([np.zeros((2, 2)), np.eye(2), np.zeros((2, 7))])
        lag = np.hstack([np.zeros((7, 4)), a]) + b @ acceleration
        return np.vstack([velocity, acceleration, lag])

    return system, first_order


# -- known answers -----------------------------------------------------------------------------------------------------


# the characteristic values a_0, b_1, a_1, b_2, a_2 of Mathieu's equation at q = 1 (https://dlmf.nist.gov/28.2), which
# scipy.special.mathieu_a and mathieu_b give to these digits
@pytest.mark.parametrize(
    ("a", "multiplier"),
    [
        (-0.45513860410741, 1.0),
        (-0.11024881699210, -1.0),
        (1.8591080725144, -1.0),
        (3.9170247729985, 1.0),
        (4.3713009827351, 1.0),
    ],
)
def test_mathieu_has_a_double_multiplier_at_the_edges_of_stability(a, multiplier):
    """x'' + (a - 2 q cos 2t) x = 0 with q = 1, tau = 2t: both multipliers, in one Jordan block."""
    system = System(
        [[1.0]],
        [[0.0]],
        [[a]],
        nonlinear_force=lambda q, v, tau, p: [-2.0 * ca.cos(tau) * q[0]],
        parameters={"omega": 2.0},
    )
    result = monodromy(system, np.zeros((1, 3)), [2.0])
    assert result.converged
    np.testing.assert_allclose(result.multipliers, multiplier, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(result.monodromy), 1.0, atol=1e-12)
    assert result.log_determinant == pytest.approx(0.0, abs=1e-12)


def test_duffing_has_the_known_multipliers(duffing_case):
    x, amplitude, multipliers = duffing_case
    assert np.hypot(*x[0, 1:3]) == pytest.approx(amplitude, abs=1e-9)
    result = monodromy(duffing(), x, [0.1, 0.18, 1.2])
    assert result.converged
    np.testing.assert_allclose(result.multipliers, multipliers, atol=6e-9)
    # exp(-2 z T), by Liouville's formula
    assert np.prod(result.multipliers).real == pytest.approx(0.7696654124932, abs=1e-12)
    assert result.stable == (np.abs(multipliers).max() < 1.0)
    np.testing.assert_allclose(np.exp(result.exponents * result.period), result.multipliers, rtol=1e-12)


def test_a_system_without_force_has_the_exponentials_of_its_eigenvalues():
    system, _ = lagged(0, 100.0)
    linear = System(
        np.eye(2),
        0.1 * np.eye(2),
        np.diag([1.0, 9.0]),
        lag_state=system.lag_state,
        lag_input=system.lag_input,
        lag_output=0.1 * np.ones((2, 7)),
        parameters={"omega": 3.0},
    )
    result = monodromy(linear, np.ones((2, 3)), [3.0])
    poles = np.linalg.eigvals(linear.linearisation())
    assert largest_error(result.multipliers, np.exp(2 * np.pi / 3 * poles)) < 1e-13
    assert largest_error(np.linalg.eigvals(result.monodromy), result.multipliers) < 1e-12
    assert result.converged
    assert result.n_intervals == 0


# -- an independent method ---------------------------------------------------------------------------------------------


def test_duffing_agrees_with_integration(duffing_case):
    x, *_ = duffing_case
    q, _ = signal(x, 1.2)
    reference = integrated(lambda t: np.array([[0, 1], [-1 - 0.3 * q(t)[0] ** 2, -0.05]]), 2 * np.pi / 1.2)
    assert largest_error(monodromy(duffing(), x, [0.1, 0.18, 1.2]).multipliers, reference) < 1e-9


@pytest.mark.parametrize("periods", [1, 3])
def test_a_velocity_dependent_force_agrees_with_integration(periods):
    system, first_order = van_der_pol_chain()
    x = 0.6 * np.random.default_rng(4).normal(size=(3, 9)) / np.repeat([1, 1, 2, 3, 4], [1, 2, 2, 2, 2])
    q, v = signal(x, 1.3 / periods)
    reference = integrated(lambda t: first_order(q(t), v(t), 1.3 * t, 0.4), 2 * np.pi * periods / 1.3)
    result = monodromy(system, x, [0.4, 1.3], periods=periods)
    assert result.converged
    assert largest_error(result.multipliers, reference) < 1e-7
    assert largest_error(np.linalg.eigvals(result.monodromy), reference) < 1e-7


@pytest.mark.parametrize(
    ("seed", "stiffest", "omega"), [(1, 50.0, 0.9), (2, 400.0, 2.0), (3, 1500.0, 6.0), (4, 50.0, 15.0)]
)
def test_lag_states_slow_and_stiff_agree_with_integration(seed, stiffest, omega):
    system, first_order = lagged(seed, stiffest)
    x = 0.4 * np.random.default_rng(seed).normal(size=(2, 7))
    q, v = signal(x, omega)
    reference = integrated(lambda t: first_order(q(t), v(t)), 2 * np.pi / omega)
    result = monodromy(system, x, [omega])
    assert result.converged
    assert largest_error(result.multipliers, reference) <= result.error + 1e-10


# -- Liouville ---------------------------------------------------------------------------------------------------------


def test_the_log_determinant_is_the_integral_of_the_trace_where_the_product_underflows():
    system, first_order = lagged(5, 400.0)
    x = 0.4 * np.random.default_rng(5).normal(size=(2, 7))
    evaluator = FloquetEvaluator(system, 1, 3, Floquet(intervals=2000))
    q, v = signal(x, 0.9)
    times = 2 * np.pi / 0.9 * np.arange(64) / 64
    integral = 2 * np.pi / 0.9 * np.mean([np.trace(first_order(q(t), v(t))) for t in times])
    assert evaluator.expected_log_determinant(x, [0.9]) == pytest.approx(integral, rel=1e-12)
    result = evaluator(x, [0.9])
    assert result.log_determinant == pytest.approx(integral, rel=1e-9)
    assert np.exp(integral) == 0.0


# -- accuracy ----------------------------------------------------------------------------------------------------------


def chain_solution():
    system, _ = van_der_pol_chain()
    return system, 0.5 * np.random.default_rng(8).normal(size=(3, 5)), [0.4, 1.3]


@pytest.mark.parametrize("nodes", [2, 3])
def test_the_order_is_twice_the_number_of_nodes(nodes):
    system, x, values = chain_solution()
    reference = monodromy(system, x, values, options=Floquet(tol=1e-12)).multipliers
    counts = np.array([32, 64, 128])
    errors = [
        largest_error(
            monodromy(
                system, x, values, options=Floquet(tol=1e-15, nodes=nodes, intervals=k, max_intervals=k)
            ).multipliers,
            reference,
        )
        for k in counts.tolist()
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2 * nodes, atol=0.25)


@pytest.mark.parametrize(
    ("nodes", "tol"), [(1, 1e-2), *((nodes, tol) for nodes in (2, 5, 8, 10) for tol in (1e-3, 1e-6, 1e-9))]
)
def test_the_estimate_bounds_the_error_and_meets_the_tolerance(nodes, tol):
    system, x, values = chain_solution()
    reference = monodromy(system, x, values, options=Floquet(tol=1e-13)).multipliers
    result = monodromy(system, x, values, options=Floquet(tol=tol, nodes=nodes))
    assert result.converged
    assert largest_error(result.multipliers, reference) <= max(result.error, 1e-12)
    assert result.error <= tol


def test_a_tolerance_out_of_reach_is_reported():
    system, x, values = chain_solution()
    result = monodromy(system, x, values, options=Floquet(nodes=2, max_intervals=20))
    assert not result.converged
    assert result.n_intervals == 20
    assert result.error > 1e-6
    assert "within 20 intervals; increase max_intervals" in result.message
    assert result.message in repr(result)


def test_a_neighbouring_result_gives_the_mesh_and_the_same_multipliers():
    system, x, values = chain_solution()
    evaluator = FloquetEvaluator(system, 1, 2, Floquet(intervals=4))
    cold = evaluator(x, values)
    again = evaluator(x, values, near=cold)
    assert largest_error(again.multipliers, cold.multipliers) < 1e-7
    assert again.converged
    assert evaluator(x, [0.4, 0.65], near=again).n_intervals >= 2 * again.next_intervals


def test_a_solution_of_period_one_seen_as_period_two_has_squared_multipliers(duffing_case):
    x, *_ = duffing_case
    doubled = np.zeros((1, 45))
    doubled[:, 0] = x[:, 0]
    doubled[:, 3::4], doubled[:, 4::4] = x[:, 1::2], x[:, 2::2]
    once = monodromy(duffing(), x, [0.1, 0.18, 1.2])
    twice = monodromy(duffing(), doubled, [0.1, 0.18, 1.2], periods=2)
    np.testing.assert_allclose(twice.multipliers, once.multipliers**2, atol=1e-12)
    np.testing.assert_allclose(twice.monodromy, once.monodromy @ once.monodromy, atol=1e-12)
    assert twice.period == pytest.approx(2 * once.period)


def test_small_multipliers_stay_accurate_beside_huge_ones():
    """A rotated pair of uncoupled equations, one of them unstable by ten decades."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    stiffness, depth = np.array([-16.0, 2.0]), np.array([4.0, 0.5])

    def parametric(q, _v, tau, _p):
        return ca.DM(turn @ np.diag(depth) @ turn.T) @ q * (ca.cos(tau) + 0.2 * ca.sin(2 * tau))

    both = System(
        np.eye(2),
        0.1 * np.eye(2),
        turn @ np.diag(stiffness) @ turn.T,
        nonlinear_force=parametric,
        parameters={"omega": 1.0},
    )
    single = [
        System(
            [[1.0]],
            [[0.1]],
            [[k]],
            nonlinear_force=lambda q, v, tau, p, d=d: [d * q[0] * (ca.cos(tau) + 0.2 * ca.sin(2 * tau))],
            parameters={"omega": 1.0},
        )
        for k, d in zip(stiffness, depth, strict=True)
    ]
    result = monodromy(both, np.zeros((2, 3)), [1.0])
    parts = [monodromy(system, np.zeros((1, 3)), [1.0]).multipliers for system in single]
    assert abs(parts[0][0]) > 1e10
    np.testing.assert_allclose(result.multipliers[1:3], parts[1], atol=1e-9)
    assert result.multipliers[0] == pytest.approx(parts[0][0], rel=1e-9)
    assert result.converged
    assert not result.stable


def test_an_overflow_is_unstable_and_not_converged():
    system = System(
        [[1.0]],
        [[0.0]],
        [[-1e6]],
        nonlinear_force=lambda q, v, tau, p: [ca.cos(tau) * q[0]],
        parameters={"omega": 1.0},
    )
    result = monodromy(system, np.zeros((1, 3)), [1.0], options=Floquet(intervals=4096))
    assert not result.stable
    assert not result.converged
    assert "overflow" in result.message


# -- forces that are no polynomials ------------------------------------------------------------------------------------


def test_a_parametric_force_of_high_harmonics_is_not_aliased():
    """cos(48 tau) looks constant on the 48 samples that suffice for cubic forces at H = 7."""
    system = System(
        [[1.0]],
        [[0.02]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [(0.3 * ca.cos(tau) + 50.0 * ca.cos(48 * tau)) * q[0]],
        parameters={"omega": 1.0},
    )
    result = monodromy(system, np.zeros((1, 15)), [1.0])
    reference = integrated(lambda t: np.array([[0, 1], [-1 - 0.3 * np.cos(t) - 50 * np.cos(48 * t), -0.02]]), 2 * np.pi)
    assert largest_error(result.multipliers, reference) < 1e-7


def test_a_kink_in_the_derivative_costs_intervals_but_not_the_bound():
    system = System(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [q[0] * ca.fabs(q[0]) + 0.3 * ca.fabs(v[0]) * v[0]],
        parameters={"omega": 1.0},
    )
    x = np.array([[0.1, 0.7, 0.3, 0.0, 0.2]])
    q, v = signal(x, 1.0)
    reference = integrated(lambda t: np.array([[0, 1], [-1 - 2 * abs(q(t)[0]), -0.1 - 0.6 * abs(v(t)[0])]]), 2 * np.pi)
    result = monodromy(system, x, [1.0])
    assert result.converged
    assert largest_error(result.multipliers, reference) <= result.error <= 1e-6
    rough = monodromy(system, x, [1.0], options=Floquet(max_intervals=10))
    assert not rough.converged
    assert largest_error(rough.multipliers, reference) <= rough.error


def test_a_derivative_that_is_not_finite_is_an_error():
    system = System([[1.0]], [[0.1]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [ca.sqrt(q[0])])
    with pytest.raises(NonFiniteError, match="not finite at theta = 0 "):
        monodromy(system, np.zeros((1, 3)), [1.0])


# -- input and output --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tol": 0.0}, "tol is 0.0"),
        ({"nodes": 13}, "nodes is 13; give an integer from 1 to 10"),
        ({"max_intervals": 1}, "max_intervals is 1"),
        ({"intervals": 9000}, "intervals is 9000; give an integer from 1 to 8192"),
    ],
)
def test_options_out_of_range_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        Floquet(**options)


@pytest.mark.parametrize(
    ("x", "values", "message"),
    [
        (np.zeros((2, 23)), [0.1, 0.18, 1.2], r"shape \(2, 23\).*\(1, 23\)"),
        (np.full((1, 23), np.nan), [0.1, 0.18, 1.2], "not finite"),
        (np.zeros((1, 23)), [0.1, 0.18], "cubic, force, omega"),
        (np.zeros((1, 23)), [0.1, 0.18, 0.0], "omega > 0"),
    ],
)
def test_unusable_arguments_are_named(x, values, message):
    with pytest.raises(ValueError, match=message):
        FloquetEvaluator(duffing(), 1, 11)(x, values)


def test_no_periods_or_harmonics_are_refused():
    with pytest.raises(ValueError, match="periods is 0 and n_harmonics 7"):
        FloquetEvaluator(duffing(), 0, 7)


def test_the_repr_is_a_summary():
    text = repr(monodromy(van_der_pol_chain()[0], np.ones((3, 3)), [0.4, 1.3]))
    assert len(text.splitlines()) <= 5
    assert text.startswith("FloquetResult: ")
    assert "... (6)" in text


def test_evaluations_do_not_touch_earlier_results(duffing_case):
    x, *_ = duffing_case
    evaluator = FloquetEvaluator(duffing(), 1, 11)
    first = evaluator(x, [0.1, 0.18, 1.2])
    kept = first.multipliers.copy(), first.monodromy.copy()
    evaluator(0.5 * x, [0.2, 0.18, 2.0])
    np.testing.assert_array_equal(first.multipliers, kept[0])
    np.testing.assert_array_equal(first.monodromy, kept[1])


# -- the pieces --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("nodes", range(1, 11))
def test_the_gauss_method_integrates_polynomials(nodes):
    gauss = Gauss.of(nodes)
    for power in range(nodes):
        at_nodes = gauss.c ** (power + 1) / (power + 1)
        np.testing.assert_allclose(gauss.inverse @ at_nodes, gauss.c**power, atol=1e-10)
    moments = [gauss.b @ gauss.c**power for power in range(2 * nodes)]
    np.testing.assert_allclose(moments, 1.0 / np.arange(1, 2 * nodes + 1), rtol=1e-13)
    rebuilt = (gauss.right / gauss.alpha) @ gauss.left
    np.testing.assert_allclose(rebuilt.real, gauss.inverse, atol=1e-9 * np.abs(gauss.inverse).max())


def test_the_product_is_in_order_of_time():
    maps = np.random.default_rng(0).normal(size=(11, 3, 3))
    whole = np.linalg.multi_dot(maps[::-1])
    for keep in (1, 2, 3, 8):
        parts = product(maps, keep)
        assert len(parts) <= keep
        np.testing.assert_allclose(product(parts)[0], whole, rtol=1e-12, atol=1e-12)


def test_the_spectrum_of_a_wide_product_is_that_of_its_factors():
    """Cyclic similarity: maps Q_{k+1} diag Q_k^T have the product of the diagonals as spectrum."""
    rng = np.random.default_rng(1)
    turns = [np.linalg.qr(rng.normal(size=(5, 5)))[0] for _ in range(12)]
    growth = np.array([20.0, 4.0, 1.1, 0.9, 0.3])
    maps = np.array([turns[(k + 1) % 12] @ np.diag(growth) @ turns[k].T for k in range(12)])
    values = np.sort(np.abs(spectrum(maps)))[::-1]
    np.testing.assert_allclose(values[:4], growth[:4] ** 12, rtol=1e-10)


def test_a_force_of_the_velocity_alone_of_one_degree_of_freedom_has_the_determinant_of_its_damping():
    """f = c v^3: by Liouville's formula log |det| = -T (d + 3 c mean(v^2))."""
    damping, c, omega = 0.1, 0.3, 1.1
    system = System([[1.0]], [[damping]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [c * v[0] ** 3])
    x = np.array([[0.0, 0.6, -0.8, 0.0, 0.0, 0.1, 0.0]])
    mean_square = omega**2 * (1.0 + (3 * 0.1) ** 2) / 2.0
    result = monodromy(system, x, [omega])
    assert result.log_determinant == pytest.approx(-result.period * (damping + 3 * c * mean_square), rel=1e-9)
