"""Systems of the literature, ready to trace; each is an example of how a user writes down their own."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.checks import real_number, whole_number
from hbnlp.systems.system import System


def duffing(*, damping_ratio: float = 0.025, cubic: float = 0.1, force: float = 0.18) -> System:
    """Return the Duffing oscillator x'' + 2 z x' + x + g x^3 = F cos(omega t), output ``"x"``.

    Parameters ``damping_ratio`` (z), ``cubic`` (g) and ``force`` (F); the defaults are the first example of NLvib
    (Krack and Gross 2019, doi:10.1007/978-3-030-14023-6).
    """
    for name, value in (("damping_ratio", damping_ratio), ("cubic", cubic), ("force", force)):
        real_number(name, value)
    return System(
        [[1.0]],
        lambda p: [[2.0 * p.damping_ratio]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": damping_ratio, "cubic": cubic, "force": force},
        name="Duffing oscillator",
    )


def chain(n_masses: int = 10, *, damping: float = 0.02, cubic: float = 0.5, force: float = 0.1) -> System:
    """Return a chain of unit masses on unit springs, each with a cubic spring to ground.

    Linear springs and dampers stand between neighbours and from the first mass to ground; ``force`` cos(omega t) acts
    on the last mass. With its symmetry-breaking branch points and legs that come close it is hard on a continuation.

    Parameters
    ----------
    n_masses : int
    damping : float
        Of the damper beside each linear spring; a parameter of the system, as are the next two.
    cubic : float
        Stiffness of the cubic springs.
    force : float
        Amplitude of the load on the last mass.

    Returns
    -------
    System
        Its outputs are the displacements ``"x1"``, ``"x2"``, ...

    Raises
    ------
    ValueError
        If there is no mass.
    """
    n_masses = whole_number("n_masses", n_masses, least=1, most=1000)
    for name, value in (("damping", damping), ("cubic", cubic), ("force", force)):
        real_number(name, value)
    springs = 2.0 * np.eye(n_masses) - np.eye(n_masses, k=1) - np.eye(n_masses, k=-1)
    springs[-1, -1] = 1.0
    return System(
        np.eye(n_masses),
        lambda p: p.damping * ca.DM(springs),
        springs,
        nonlinear_force=lambda q, v, tau, p: p.cubic * q**3,
        forcing=lambda tau, p: [0.0] * (n_masses - 1) + [p.force * ca.cos(tau)],
        parameters={"damping": damping, "cubic": cubic, "force": force},
        name=f"chain of {n_masses} masses",
    )


def tuned_absorber(
    *,
    force: float = 0.15,
    mass_ratio: float = 0.05,
    damping: float = 0.002,
    absorber_stiffness: float = 0.0453506255416,
    absorber_damping: float = 0.0127558546415,
    absorber_cubic: float = 0.0041666666667,
) -> System:
    """Return a Duffing oscillator with a nonlinear tuned vibration absorber.

    x1'' + c1 x1' + x1 + x1^3 and eps x2'', coupled by a damper c2, a spring k2 and a cubic spring; ``force`` cos(omega
    t) acts on the host. Its response has a detached branch (isola) for .123 < force < .181.

    Parameters
    ----------
    force : float
        Amplitude of the load on the host; a parameter of the system, as are all the others.
    mass_ratio : float
        eps, mass of the absorber; the host's is 1.
    damping : float
        c1, of the host.
    absorber_stiffness, absorber_damping, absorber_cubic : float
        k2, c2 and the factor of the cubic spring between the two.

    Returns
    -------
    System
        Its outputs are the displacements ``"x1"`` (host) and ``"x2"`` (absorber).

    References
    ----------
    Detroux, Habib, Masset, Kerschen (2015), Mech. Syst. Signal Process. 60-61, 799-809,
    doi:10.1016/j.ymssp.2015.01.035.
    """
    given = {
        "force": force,
        "mass_ratio": mass_ratio,
        "damping": damping,
        "absorber_stiffness": absorber_stiffness,
        "absorber_damping": absorber_damping,
        "absorber_cubic": absorber_cubic,
    }
    parameters = {name: real_number(name, value) for name, value in given.items()}
    tie = ca.DM([[1.0, -1.0], [-1.0, 1.0]])
    host = ca.DM([[1.0, 0.0], [0.0, 0.0]])
    return System(
        lambda p: ca.diag(ca.vertcat(1.0, p.mass_ratio)),
        lambda p: p.damping * host + p.absorber_damping * tie,
        lambda p: host + p.absorber_stiffness * tie,
        nonlinear_force=lambda q, v, tau, p: [
            q[0] ** 3 + p.absorber_cubic * (q[0] - q[1]) ** 3,
            p.absorber_cubic * (q[1] - q[0]) ** 3,
        ],
        forcing=lambda tau, p: [p.force * ca.cos(tau), 0.0],
        parameters=parameters,
        name="oscillator with nonlinear tuned absorber",
    )
