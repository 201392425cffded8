"""Harmonic balance: Fourier coefficients as decision variables, the residual as a CasADi expression, and its program.

The residual is the dynamic stiffness of each harmonic (the static one included, the lag states eliminated exactly)
plus the Fourier coefficients of the force by alternating frequency/time; see Cameron and Griffin (1989),
doi:10.1115/1.3176036.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from math import ceil
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.assembly import Assembly
from hbnlp.balance.sampling import MOST_SAMPLES, polynomial_degree, sufficient_samples
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import FourierBasis, differentiation, n_coefficients, resize, to_complex
from hbnlp.systems.system import System

ALIASING_TOL = 1e-9
"""More samples of the force must not move the residual by more than this, relative to its terms."""


class HarmonicBalance:
    """The periodic solutions of a system with H harmonics, as square equations and as a nonlinear program.

    Parameters
    ----------
    system : System
        What is to be balanced.
    n_harmonics : int
        H >= 1. The unknowns are the (2H+1) n coefficients of the displacements.
    periods : int
        Length of the solution in periods of the forcing: 2 for a period-doubled one; the harmonics are then those of
        omega / periods.
    n_samples : int, optional
        Samples a solution period for the nonlinear force, taken as given. By default exact for a polynomial force,
        (d + 1) H + 1; otherwise a start that `hbnlp.solve` and `hbnlp.trace` double until the residual moves by less
        than the tolerance.

    Attributes
    ----------
    x, p : casadi.MX
        Decision variables, (n (2H+1),), ordered as the array (n, 2H+1) row by row; parameters in the order of
        ``system.parameters.names``.
    g : casadi.MX
        The residual, of the size and order of x.

    Raises
    ------
    ValueError
        For H < 1, fewer than one period, or too few samples.

    References
    ----------
    Cameron, Griffin (1989), J. Appl. Mech. 56, 149-154, doi:10.1115/1.3176036 (alternating frequency/time).
    """

    def __init__(self, system: System, n_harmonics: int, *, periods: int = 1, n_samples: int | None = None) -> None:
        if not isinstance(system, System):
            raise TypeError(f"system is {system!r}; an hbnlp.System is needed")
        given = {"n_harmonics": n_harmonics, "periods": periods, "n_samples": 1 if n_samples is None else n_samples}
        for name, value in given.items():
            if not isinstance(value, int | np.integer) or value < 1:
                raise ValueError(f"{name} = {value!r}; a whole number of at least 1 is needed")
        self.system = system
        self.n_harmonics = int(n_harmonics)
        self.periods = int(periods)
        self._samples_given = self.samples_are_settled = n_samples is not None
        if n_samples is None:
            degree = polynomial_degree(system)
            self.samples_are_settled = degree is not None
            n_samples = sufficient_samples(self.n_harmonics, degree)
        self.basis = FourierBasis(self.n_harmonics, int(n_samples))
        self.shape = (system.n_dof, n_coefficients(self.n_harmonics))
        self.size = self.shape[0] * self.shape[1]

    @property
    def n_samples(self) -> int:
        """Samples of the force in one period of the solution."""
        return self.basis.n_samples

    @cached_property
    def assembly(self) -> Assembly:
        """Residual and derivatives as fast numpy arrays."""
        return Assembly(self.system, self.basis, self.periods)

    def with_harmonics(self, n_harmonics: int) -> HarmonicBalance:
        """Return the balance of the same system with another number of harmonics.

        Where the number of samples was given, or had to be raised, there are no fewer, nor fewer a harmonic.
        """
        other = HarmonicBalance(self.system, n_harmonics, periods=self.periods)
        if not self._samples_given:
            return other
        in_proportion = ceil(self.n_samples * max(1.0, n_harmonics / self.n_harmonics))
        n_samples = max(other.n_samples, min(in_proportion, max(MOST_SAMPLES, self.n_samples)))
        other = HarmonicBalance(self.system, n_harmonics, periods=self.periods, n_samples=n_samples)
        other.samples_are_settled = self.samples_are_settled
        return other

    def oversampled(self) -> HarmonicBalance:
        """Return the same balance with twice the samples (always the same object, so that it is built once)."""
        return self._oversampled

    @cached_property
    def _oversampled(self) -> HarmonicBalance:
        if 2 * self.n_samples > MOST_SAMPLES:
            raise ValueError(
                f"{2 * self.n_samples} samples a period would be needed for the force, more than {MOST_SAMPLES}: "
                "it is not smooth enough for this tolerance; smooth it or pass n_samples"
            )
        finer = HarmonicBalance(self.system, self.n_harmonics, periods=self.periods, n_samples=2 * self.n_samples)
        finer.samples_are_settled = False
        return finer

    def samples_suffice(self, x: Array, values: Array) -> bool:
        """Return whether twice the samples of the force leave the residual at a solution within the tolerance."""
        if self.samples_are_settled:
            return True
        fine, coarse = (each.assembly.residual(x, values) for each in (self.oversampled(), self))
        moved = float(np.max(np.abs(fine - coarse)))
        return moved <= ALIASING_TOL * max(self.assembly.term_size(x, values), float(np.finfo(float).tiny))

    def vector(self, coefficients: ArrayLike) -> Array:
        """Return coefficients (n, any odd number), cut or padded to 2H+1, as a vector of unknowns."""
        array = np.asarray(coefficients, dtype=float)
        if array.ndim != 2 or array.shape[0] != self.shape[0] or array.shape[1] % 2 == 0:
            raise ValueError(f"coefficients have shape {array.shape}; ({self.shape[0]}, 2H+1) is needed")
        return resize(array, self.n_harmonics).ravel()

    # -- the program ------------------------------------------------------------------------------------------------

    @cached_property
    def x(self) -> ca.MX:
        """Decision variables, (n (2H+1),)."""
        return ca.MX.sym("x", self.size)

    @cached_property
    def p(self) -> ca.MX:
        """Parameters, in the order of ``system.parameters.names``."""
        return ca.MX.sym("p", len(self.system.parameters.names))

    @cached_property
    def g(self) -> ca.MX:
        """Residual, of the size and order of x."""
        system, basis = self.system, self.basis
        coefficients = ca.reshape(self.x, self.shape[1], self.shape[0])
        balance = self._linear_balance(coefficients)
        if system.is_nonlinear:
            omega = self.parameter("omega") / self.periods
            q = (ca.DM(basis.sampling) @ coefficients).T
            v = omega * (ca.DM(basis.derivative_sampling) @ coefficients).T
            arguments = [system.q, system.v, system.tau, system.p]
            force = ca.Function("force", arguments, [ca.densify(system.force)]).map(basis.n_samples)
            tau = self.periods * basis.theta[None, :]
            samples = force(q, v, tau, ca.repmat(self.p, 1, basis.n_samples))
            balance += ca.DM(basis.projection) @ samples.T
        return ca.vec(balance)

    @property
    def nlp(self) -> dict[str, ca.MX]:
        """The square problem as CasADi's own ``{x, p, f, g}``: find x with g = 0 (f = 0)."""
        return {"x": self.x, "p": self.p, "f": ca.MX(0), "g": self.g}

    @cached_property
    def residual(self) -> ca.Function:
        """CasADi function (x, p) -> g."""
        return ca.Function("residual", [self.x, self.p], [self.g], ["x", "p"], ["g"])

    @cached_property
    def jacobian(self) -> ca.Function:
        """CasADi function (x, p) -> dg/dx."""
        return ca.Function("jacobian", [self.x, self.p], [ca.jacobian(self.g, self.x)], ["x", "p"], ["jac_g_x"])

    def parameter(self, name: str) -> ca.MX:
        """Return the symbol of a parameter in the program."""
        return self.p[self.system.parameters.index(name)]

    def coefficients(self, dof: int) -> ca.MX:
        """Return the symbols a_0, a_1, ... (2H+1,) of one displacement."""
        length = self.shape[1]
        return self.x[dof * length : (dof + 1) * length]

    def output(self, name: str) -> ca.MX:
        """Return the coefficients (2H+1,) of a named output as an expression of x and p."""
        return self._output_coefficients[self.system.output_index(name), :].T

    def amplitude_squared(self, name: str, harmonic: int = 1) -> ca.MX:
        """Return the squared amplitude of one harmonic (h >= 1) of a named output as an expression of x and p."""
        if not 1 <= harmonic <= self.n_harmonics:
            raise ValueError(f"harmonic = {harmonic}; 1 to {self.n_harmonics} are retained")
        return ca.sumsqr(self.output(name)[2 * harmonic - 1 : 2 * harmonic + 1])

    @cached_property
    def output_function(self) -> ca.Function:
        """CasADi function (x, p) -> coefficients (n_outputs, 2H+1) of all outputs."""
        return ca.Function("outputs", [self.x, self.p], [self._output_coefficients])

    def output_harmonics(self, x: ArrayLike, values: ArrayLike) -> ComplexArray:
        """Return the amplitudes (n_points, n_outputs, H+1) of all outputs at points x (n_points, size)."""
        points, parameters = np.atleast_2d(x), np.atleast_2d(values)
        count, n_out = points.shape[0], len(self.system.output_names)
        if n_out == 0:
            return np.zeros((count, 0, self.n_harmonics + 1), dtype=complex)
        columns = self.output_function.map(count)(points.T, parameters.T).full()
        return to_complex(columns.reshape(n_out, count, self.shape[1]).transpose(1, 0, 2))

    # -- building blocks --------------------------------------------------------------------------------------------

    def _linear_balance(self, coefficients: ca.MX) -> ca.MX:
        """Return the coefficients (2H+1, n) of M q'' + D q' + K q - L_x x - excitation."""
        mass, damping, stiffness, lag_output = self.system.matrices(self.p)[:4]
        first, second = self._derivatives(coefficients)
        balance = second @ mass.T + first @ damping.T + coefficients @ stiffness.T
        load, lag_motion = self._excitation
        if self.system.n_lags:
            balance -= self._lag_states(second, lag_motion) @ lag_output.T
        return balance - load

    def _derivatives(self, coefficients: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the coefficients of the first and second derivative by time."""
        by_phase = ca.DM(differentiation(self.n_harmonics))
        rate = self.parameter("omega") / self.periods
        first = rate * (ca.sparsify(by_phase) @ coefficients)
        return first, rate * (ca.sparsify(by_phase) @ first)

    @cached_property
    def _excitation(self) -> tuple[ca.MX, ca.MX]:
        """Coefficients (2H+1, n) of the load and (2H+1, m) of B_u u''."""
        basis = self.assembly.linear.excitation_basis
        tau = self.periods * basis.theta[None, :]
        samples = self.system.excitation.map(basis.n_samples)(tau, ca.repmat(self.p, 1, basis.n_samples))
        load, lag_motion = (ca.DM(basis.projection) @ s.T for s in samples)
        return load, lag_motion

    def _lag_states(self, acceleration: ca.MX, lag_motion: ca.MX) -> ca.MX:
        """Return the coefficients (2H+1, m) of x, from (s - A) x = B q'' + B_u u'' in A's eigenvectors."""
        lags = self.assembly.linear.lags
        drive = acceleration @ ca.DM(self.system.lag_input.T) + lag_motion
        inverse = np.linalg.inv(lags.vectors)
        drive_r, drive_i = drive @ ca.DM(inverse.real.T), drive @ ca.DM(inverse.imag.T)
        rate = self.parameter("omega") / self.periods
        rows = []
        for h in range(self.n_harmonics + 1):
            # an amplitude a - i b: its real and imaginary parts in eigenvector coordinates, each times 1 / (s - pole)
            cosine = 2 * h - 1 if h else 0
            real, imaginary = drive_r[cosine, :], drive_i[cosine, :]
            if h:
                real, imaginary = real + drive_i[2 * h, :], imaginary - drive_r[2 * h, :]
            over_r, over_i = ca.DM(-lags.poles.real[None, :]), h * rate - ca.DM(lags.poles.imag[None, :])
            size = over_r**2 + over_i**2
            state_r = (real * over_r + imaginary * over_i) / size
            state_i = (imaginary * over_r - real * over_i) / size
            vectors_r, vectors_i = ca.DM(lags.vectors.real.T), ca.DM(lags.vectors.imag.T)
            rows.append(state_r @ vectors_r - state_i @ vectors_i)
            if h:
                rows.append(-(state_r @ vectors_i + state_i @ vectors_r))
        return ca.vertcat(*rows)

    @cached_property
    def _output_coefficients(self) -> ca.MX:
        """Coefficients (n_outputs, 2H+1), projected from samples of the signals."""
        coefficients = ca.reshape(self.x, self.shape[1], self.shape[0])
        first, second = self._derivatives(coefficients)
        lags = self._lag_states(second, self._excitation[1]) if self.system.n_lags else ca.MX(self.shape[1], 0)
        basis = FourierBasis(self.n_harmonics, max(self.n_samples, 8 * self.n_harmonics + 1))
        signals = [(ca.DM(basis.sampling) @ c).T for c in (coefficients, first, second, lags)]
        tau = self.periods * basis.theta[None, :]
        samples = self.system.outputs.map(basis.n_samples)(*signals, tau, ca.repmat(self.p, 1, basis.n_samples))
        return samples @ ca.DM(basis.projection.T)

    def values(self, at: Mapping[str, float] | None = None, **options: Any) -> Array:
        """Return all parameter values in order, the defaults overridden by ``at``."""
        return self.system.parameters.values(at, **options)

    def __repr__(self) -> str:
        period = f", {self.periods} forcing periods" if self.periods > 1 else ""
        settled = "settled" if self.samples_are_settled else "doubled where they do not suffice"
        return (
            f"HarmonicBalance of {self.system.name!r}: {self.n_harmonics} harmonics{period}, {self.size} unknowns\n"
            f"  {self.n_samples} samples a period ({settled})"
        )
