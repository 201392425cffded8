"""The supplied systems, held to their equations written out in numpy."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.systems import chain, duffing, tuned_absorber


def balance(system, q, v, a, tau, at):
    """M a + D v + K q + f - forcing as numbers."""
    values = system.parameters.values(at)
    mass, damping, stiffness, _ = system.state_matrices(values)
    function = ca.Function("f", [system.q, system.v, system.tau, system.p], [system.force - system.forcing])
    return mass @ a + damping @ v + stiffness @ q + function(q, v, tau, values).full().ravel()


def test_duffing_is_the_equation_of_the_literature():
    z, g, force, omega, t = 0.03, 0.2, 0.4, 1.7, 0.9
    found = balance(duffing(damping_ratio=z, cubic=g, force=force), [0.5], [0.7], [0.2], omega * t, {"omega": omega})
    assert found[0] == pytest.approx(0.2 + 2 * z * 0.7 + 0.5 + g * 0.5**3 - force * np.cos(omega * t), abs=1e-15)


def test_the_chain_is_written_out_for_three_masses():
    q, v, a, tau = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.6]), np.array([1.0, 2.0, 3.0]), 0.4
    c, g, force = 0.02, 0.5, 0.1

    def tie(y):
        return np.array([2 * y[0] - y[1], 2 * y[1] - y[0] - y[2], y[2] - y[1]])

    expected = a + c * tie(v) + tie(q) + g * q**3 - np.array([0.0, 0.0, force * np.cos(tau)])
    np.testing.assert_allclose(balance(chain(3), q, v, a, tau, {"omega": 1.0}), expected, atol=1e-15)


@pytest.mark.parametrize("n", [1, 4, 10])
def test_the_frequencies_of_the_chain_are_those_of_a_fixed_free_chain(n):
    stiffness = chain(n).state_matrices(chain(n).parameters.values({"omega": 1.0}))[2]
    exact = 2.0 * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1)))
    np.testing.assert_allclose(np.sqrt(np.linalg.eigvalsh(stiffness)), exact, rtol=1e-12)


def test_the_absorber_is_the_equation_of_the_literature():
    q, v, a, tau = np.array([0.8, -0.5]), np.array([0.3, 0.9]), np.array([-0.4, 0.6]), 1.1
    eps, c1, k2, c2, k3, force = 0.05, 0.002, 0.0453506255416, 0.0127558546415, 0.0041666666667, 0.15
    tie = c2 * (v[0] - v[1]) + k2 * (q[0] - q[1]) + k3 * (q[0] - q[1]) ** 3
    expected = [a[0] + c1 * v[0] + q[0] + q[0] ** 3 + tie - force * np.cos(tau), eps * a[1] - tie]
    np.testing.assert_allclose(balance(tuned_absorber(), q, v, a, tau, {"omega": 1.0}), expected, atol=1e-15)


def test_their_outputs_are_the_displacements():
    assert duffing().output_names == ("x",)
    assert chain().output_names == tuple(f"x{i}" for i in range(1, 11))
    assert tuned_absorber().output_names == ("x1", "x2")


def test_a_chain_without_masses_is_refused():
    with pytest.raises(ValueError, match="n_masses is 0; give an integer from 1"):
        chain(0)
