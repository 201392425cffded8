"""Laws of tension: half of the energy's derivative, from the same tension at rest."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from hbnlp.wing.tension import ConstantTension, ElasticTension

P = SimpleNamespace(mass_ratio=0.5, stiffness=30.0, prestrain=0.01)
LAWS = [ConstantTension(), ElasticTension()]


@pytest.mark.parametrize("law", LAWS)
def test_tension_is_half_the_energys_derivative_and_the_rate_its_own(law):
    delta = ca.SX.sym("delta")
    energy, tension = law.energy(delta, P), law.tension(delta, P)
    derivatives = ca.Function("d", [delta], [ca.gradient(energy, delta) / 2.0, ca.jacobian(tension, delta)])
    half, rate = (float(value) for value in derivatives(0.03))
    assert law.tension(0.03, P) == pytest.approx(half, rel=1e-14)
    assert law.rate(P) == pytest.approx(rate, rel=1e-14)


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_all_laws_agree(law):
    assert law.tension(0.0, P) == law.at_rest(P) == 2 * 30.0 * 0.01
    assert law.energy(0.0, P) == pytest.approx(2 * 30.0 * 0.01**2, rel=1e-14)
    assert law.rise(0.0, P) == 0.0


def test_strain_leaves_a_constant_tension_and_stretches_an_elastic_one():
    constant, elastic = (law.tension(np.array([0.0, 0.02]), P) for law in LAWS)
    np.testing.assert_array_equal(constant, [0.6, 0.6])
    np.testing.assert_allclose(elastic, [0.6, 1.8], rtol=1e-14)


def test_the_rise_of_a_constant_tension_is_an_exact_zero():
    assert ConstantTension().rise(ca.SX.sym("delta"), P).is_zero()
    assert ConstantTension().rise(ca.MX.sym("delta"), P).is_zero()
