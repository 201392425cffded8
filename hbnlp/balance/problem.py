"""Harmonic balance: Fourier coefficients as decision variables, the residual as a CasADi expression, and its program.

The residual is the dynamic stiffness of each harmonic (the static one included, the lag states eliminated exactly)
plus the Fourier coefficients of the force by alternating frequency/time; see Cameron and Griffin (1989),
doi:10.1115/1.3176036.
"""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.assembly import Assembly
from hbnlp.balance.corners import Corner, Corners
from hbnlp.balance.odd import OddAssembly
from hbnlp.balance.output_groups import warn_of_switches
from hbnlp.balance.outputs import Outputs
from hbnlp.balance.sampling import ALIASING_TOL, Sampling
from hbnlp.balance.symbolic import Symbols
from hbnlp.balance.truncation import Truncation
from hbnlp.core.checks import finite_array, instance_of, whole_number
from hbnlp.core.errors import CornerError
from hbnlp.core.kept import Kept, built_once
from hbnlp.core.renamed import renamed_name
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import n_coefficients, resize, to_complex
from hbnlp.systems.system import System

MOST_RELATIVES = 64
"""Balances of one system with other numbers of harmonics or samples that are kept."""

_RENAMED = {
    "output_function": "problem.output(name), an expression of problem.x and problem.p; solutions have harmonics(name)",
    "parameter": "problem.symbol(name)",
}


class HarmonicBalance:
    """The periodic solutions of a system with H harmonics, as square equations and as a nonlinear program.

    Parameters
    ----------
    system : System
        What is to be balanced.
    n_harmonics : int, optional
        H >= 1, the same for all solutions. The unknowns are the (2H+1) n coefficients of the displacements.
    tolerance : float, optional
        Instead of a number of harmonics: the bound, from 1e-9 to 0.1, on the error for want of them. Each solution
        then has as many as its estimated error asks for, more or fewer from one to the next along a branch. It holds
        for each displacement relative to its size in the solution, or to a thousandth of the largest on the branch
        where that is more: near rest.
    outputs : sequence of str
        With a tolerance: the outputs that are to meet it as well. A force holds accelerations, and needs more.
    most_harmonics : int, optional
        With a tolerance: how many may be taken, by default 127 of the forcing's frequency. Where they do not do, the
        records say so.
    periods : int
        Length of the solution in periods of the forcing: 2 for a period-doubled one; the harmonics are then those of
        omega / periods.
    n_samples : int, optional
        Samples a solution period for the nonlinear force, taken as given. By default exact for a polynomial force,
        (d + 1) H + 1; otherwise a start that `hbnlp.solve` and `hbnlp.trace` double until the residual moves by less
        than the tolerance.

    Attributes
    ----------
    sampling : Sampling
        How many samples force, excitation and outputs take.
    truncation : Truncation or None
        The tolerance, where there is one. The balance itself then has the number of harmonics that solutions begin
        with; each solution has the balance with its own, ``solution.problem``.
    kept : Kept
        What analyses compile for this balance and ask for again.
    x, p : casadi.MX
        Decision variables, (n (2H+1),), ordered as the array (n, 2H+1) row by row; parameters in the order of
        ``system.parameters.names``.
    g : casadi.MX
        The residual, of the size and order of x.

    Raises
    ------
    ValueError
        For H < 1, fewer than one period, or too few samples; for a tolerance out of its bounds or a cap too low.
    TypeError
        For both a number of harmonics and a tolerance, or neither.
    KeyError
        For an output that the system does not have.

    Notes
    -----
    Many methods: a program is put together from them by their names (as CasADi's own ``x``, ``p``, ``g``), and none
    does more than ask the sampling, the symbols or the assembly.

    References
    ----------
    Cameron, Griffin (1989), J. Appl. Mech. 56, 149-154, doi:10.1115/1.3176036 (alternating frequency/time).
    """

    def __init__(
        self,
        system: System,
        n_harmonics: int | None = None,
        *,
        tolerance: float | None = None,
        outputs: Sequence[str] = (),
        most_harmonics: int | None = None,
        periods: int = 1,
        n_samples: int | None = None,
    ) -> None:
        instance_of("system", system, System, "an hbnlp.System")
        truncation = None
        if tolerance is not None:
            truncation = Truncation.of(system, tolerance, outputs, most_harmonics, periods)
        elif most_harmonics is not None or outputs:
            name, value = ("outputs", outputs) if outputs else ("most_harmonics", most_harmonics)
            raise TypeError(f"{name} is {value!r}, which goes with a tolerance; give tolerance=1e-4, or leave it out")
        if (n_harmonics is None) is (truncation is None):
            given = (
                "neither is given" if truncation is None else f"n_harmonics is {n_harmonics!r}, tolerance {tolerance!r}"
            )
            raise TypeError(f"{given}; give n_harmonics=7, the same for all solutions, or tolerance=1e-4")
        number = truncation.first if truncation is not None else n_harmonics
        assert number is not None
        self._set_up(system, Sampling.of(system, number, periods, n_samples), truncation, self)

    def _set_up(
        self, system: System, sampling: Sampling, truncation: Truncation | None, origin: HarmonicBalance
    ) -> None:
        self.system, self.sampling, self.truncation = system, sampling, truncation
        # a weak reference: with a circle, what is compiled would outlive its last user
        self._origin, self._relatives = weakref.ref(origin), Kept[HarmonicBalance](MOST_RELATIVES)
        self.kept: Kept[Any] = Kept(4)
        self.n_harmonics, self.periods, self.basis = sampling.n_harmonics, sampling.periods, sampling.force
        self.shape = (system.n_dof, n_coefficients(self.n_harmonics))
        self.size = self.shape[0] * self.shape[1]

    # -- other numbers of harmonics and samples ---------------------------------------------------------------------

    def with_harmonics(self, n_harmonics: int) -> HarmonicBalance:
        """Return the balance of the same system with another number of harmonics (always the same, built once).

        Where the number of samples was given, or had to be raised, there are no fewer.
        """
        return self._with(self.sampling.with_harmonics(n_harmonics))

    def carrying(self, n_harmonics: int) -> HarmonicBalance:
        """Return the balance for a solution of so many harmonics: its own where there is a tolerance, or this one."""
        return self if self.truncation is None else self.with_harmonics(n_harmonics)

    def oversampled(self) -> HarmonicBalance:
        """Return the same balance with twice the samples (always the same, built once)."""
        return self._with(self.sampling.doubled())

    def _with(self, sampling: Sampling) -> HarmonicBalance:
        """Return the relative with this sampling, kept by the balance from which all have come while it lives."""
        origin = self._origin() or self
        for known in (origin, self):
            if sampling == known.sampling:
                return known

        def relative() -> HarmonicBalance:
            return HarmonicBalance._of(self.system, sampling, self.truncation, origin)

        return origin._relatives.get(sampling, relative)

    @classmethod
    def _of(
        cls,
        system: System,
        sampling: Sampling,
        truncation: Truncation | None,
        origin: HarmonicBalance | None = None,
    ) -> HarmonicBalance:
        problem = object.__new__(cls)
        problem._set_up(system, sampling, truncation, origin or problem)
        return problem

    def over_twice_the_period(self) -> HarmonicBalance:
        """Return the balance of motions over twice the period, with the same harmonics of the forcing."""
        sampling = Sampling.of(self.system, 2 * self.n_harmonics, 2 * self.periods)
        truncation = self.truncation.doubled() if self.truncation is not None else None
        return HarmonicBalance._of(self.system, sampling, truncation)

    # -- copies and other processes ---------------------------------------------------------------------------------

    def __reduce__(self) -> tuple[Callable[..., HarmonicBalance], tuple[Any, ...]]:
        """Send the system and the samplings; what was compiled stays, and is compiled once where it arrives."""
        return _received, (self.system, (self._origin() or self).sampling, self.sampling, self.truncation)

    def __deepcopy__(self, memo: dict[int, Any]) -> HarmonicBalance:
        """Return another balance of a copy of the system, which shares nothing with this one."""
        return HarmonicBalance._of(copy.deepcopy(self.system, memo), self.sampling, self.truncation)

    def __copy__(self) -> HarmonicBalance:
        return HarmonicBalance._of(self.system, self.sampling, self.truncation)

    @property
    def n_samples(self) -> int:
        """Samples of the force in one period of the solution."""
        return self.sampling.n_samples

    @property
    def samples_are_settled(self) -> bool:
        """Whether the samples of the force are known to do: exact, or the user's word."""
        return self.sampling.settled

    def samples_suffice(self, x: Array, values: Array) -> bool:
        """Return whether twice the samples of the force leave the residual at a solution within the aliasing tolerance.

        Parameters
        ----------
        x : array (n (2H+1),)
        values : array (n_parameters,)

        Raises
        ------
        SamplingError
            If they do not and the force has a corner, which no number resolves: a CornerError, which says where.
        """
        if self.samples_are_settled:
            return True
        if self.sampling.may_double and self.aliasing(x, values) <= ALIASING_TOL:
            # what is narrower than a sample lies between those of both; the tail of a kink's harmonics may go on a bit
            dense = self._with(self.sampling.dense())
            if self._moved_by(dense, x, values) <= 10.0 * ALIASING_TOL:
                return True
        corner = self.corner(x, values) if self.sampling.doubles_to_many else None
        if corner is not None:
            raise CornerError(str(corner))
        return False

    def with_enough_samples(self, x: Array, values: Array) -> HarmonicBalance:
        """Return the same balance with the samples of the force that suffice at a solution; see `samples_suffice`."""
        problem = self
        while not problem.samples_suffice(x, values):
            problem = problem.oversampled()
        return problem

    def check_doubling(self, x: Array, values: Array) -> None:
        """Raise a CornerError if the force has a corner on a motion for which even the most samples are too few.

        It says at once what all doublings would come to, were the motion to stay as it is.
        """
        corner = None if self.sampling.doubles_to_many else self.corner(x, values)
        if corner is not None and self._with(self.sampling.last_doubled()).aliasing(x, values) > ALIASING_TOL:
            raise CornerError(str(corner))

    def aliasing(self, x: Array, values: Array) -> float:
        """Return by how much twice the samples of the force move the residual, relative to its terms."""
        return self._moved_by(self.oversampled(), x, values)

    def _moved_by(self, finer: HarmonicBalance, x: Array, values: Array) -> float:
        fine, coarse = (each.assembly.residual(x, values) for each in (finer, self))
        size = max(self.assembly.term_size(x, values), float(np.finfo(float).tiny))
        return float(np.max(np.abs(fine - coarse))) / size

    def corner(self, x: Array, values: Array) -> Corner | None:
        """Return the worst corner of the force on a motion, x (n (2H+1),) at values (n_parameters,); None without."""
        return self._corners.worst(x.reshape(self.shape), values)

    @built_once
    def _corners(self) -> Corners:
        return Corners(self.system, self.periods, settled=self.samples_are_settled)

    @built_once
    def assembly(self) -> Assembly:
        """Residual and derivatives as fast numpy arrays."""
        return Assembly(self.system, self.sampling)

    @built_once
    def odd_assembly(self) -> OddAssembly:
        """The same on odd motions, for equations that change sign with half a period."""
        return OddAssembly(self.system, self.sampling, self.assembly.linear)

    def vector(self, coefficients: ArrayLike) -> Array:
        """Return coefficients (n, any odd number), cut or padded to 2H+1, as a vector of unknowns."""
        array = finite_array("coefficients", coefficients, (self.shape[0], None))
        if array.shape[1] % 2 == 0:
            raise ValueError(f"coefficients has shape {array.shape}; give an array of shape ({self.shape[0]}, 2H+1)")
        return resize(array, self.n_harmonics).ravel()

    def values(self, at: Mapping[str, float] | None = None, **options: Any) -> Array:
        """Return all parameter values in order, the defaults overridden by ``at``."""
        return self.system.parameters.values(at, **options)

    # -- the program ------------------------------------------------------------------------------------------------

    @built_once
    def symbols(self) -> Symbols:
        """Unknowns, parameters, residual and outputs as expressions."""
        return Symbols(self.system, self.sampling)

    @property
    def x(self) -> ca.MX:
        """Decision variables, (n (2H+1),)."""
        return self.symbols.x

    @property
    def p(self) -> ca.MX:
        """Parameters, in the order of ``system.parameters.names``."""
        return self.symbols.p

    @property
    def g(self) -> ca.MX:
        """Residual, of the size and order of x."""
        return self.symbols.residual

    @property
    def nlp(self) -> dict[str, ca.MX]:
        """The square problem as CasADi's own ``{x, p, f, g}``: find x with g = 0 (f = 0)."""
        return {"x": self.x, "p": self.p, "f": ca.MX(0), "g": self.g}

    @built_once
    def residual(self) -> ca.Function:
        """CasADi function (x, p) -> g."""
        return ca.Function("residual", [self.x, self.p], [self.g], ["x", "p"], ["g"])

    @built_once
    def jacobian(self) -> ca.Function:
        """CasADi function (x, p) -> dg/dx."""
        return ca.Function("jacobian", [self.x, self.p], [ca.jacobian(self.g, self.x)], ["x", "p"], ["jac_g_x"])

    def symbol(self, name: str) -> ca.MX:
        """Return the symbol of a parameter in the program."""
        return self.symbols.symbol(name)

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("HarmonicBalance", name, _RENAMED)

    def coefficients(self, dof: int) -> ca.MX:
        """Return the symbols a_0, a_1, ... (2H+1,) of one displacement."""
        length, dof = self.shape[1], whole_number("dof", dof, least=0, most=self.shape[0] - 1)
        return self.x[dof * length : (dof + 1) * length]

    def output(self, name: str) -> ca.MX:
        """Return the coefficients (2H+1,) of a named output as an expression of x and p.

        Harmonics of outputs that switch are less exact there than those of solutions and branches: an AliasingWarning.
        """
        warn_of_switches(self.system, name)
        return self.symbols.outputs[self.system.output_index(name), :].T

    def amplitude_squared(self, name: str, harmonic: int = 1) -> ca.MX:
        """Return the squared amplitude of one harmonic (h >= 1) of a named output as an expression of x and p."""
        whole_number("harmonic", harmonic, least=1, most=self.n_harmonics, advice=", which are retained")
        return ca.sumsqr(self.output(name)[2 * harmonic - 1 : 2 * harmonic + 1])

    def output_harmonics(self, x: ArrayLike, values: ArrayLike) -> ComplexArray:
        """Return the amplitudes (n_points, n_outputs, H+1) of all outputs at points x (n_points, size)."""
        points, parameters = np.atleast_2d(x), np.atleast_2d(values)
        return to_complex(self._outputs.coefficients(points.reshape(-1, *self.shape), parameters))

    @built_once
    def _outputs(self) -> Outputs:
        return Outputs(self.system, self.sampling, self.assembly.linear)

    def __repr__(self) -> str:
        period = f", {self.periods} forcing periods" if self.periods > 1 else ""
        settled = "settled" if self.samples_are_settled else "doubled where they do not suffice"
        exact = f" (tolerance {self.truncation.tolerance:g})" if self.truncation is not None else ""
        harmonics = f"{self.n_harmonics} harmonics{exact}{period}"
        return (
            f"HarmonicBalance of {self.system.name!r}: {harmonics}, {self.size} unknowns\n"
            f"  {self.n_samples} samples a period ({settled})"
        )


_RECEIVED: Kept[HarmonicBalance] = Kept(8)


def _received(system: System, original: Sampling, sampling: Sampling, truncation: Truncation | None) -> HarmonicBalance:
    """Return a balance that came from elsewhere: of a system received before, the one that is compiled already."""
    origin = _RECEIVED.get((system, original, truncation), lambda: HarmonicBalance._of(system, original, truncation))
    return origin._with(sampling)
