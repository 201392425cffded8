"""Linear frequency response of membrane wings of several tensions, beside the rigid wing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import finite_numbers, instance_of, real_number
from hbnlp.core.extras import from_extra
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.layout import Column, Layout
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray
from hbnlp.systems.linear_stability import eigenvalues
from hbnlp.systems.parameters import OMEGA
from hbnlp.systems.response_about_rest import linear_response
from hbnlp.systems.system import System
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes


_LAYOUT = Layout(
    kind="lift response",
    columns={
        "omega": Column("omega", about="angular frequency, U/c", units="1"),
        "tensions": Column("tensions", about="c_T = 2 Eh delta0 at rest", units="1"),
        "membrane": Column("tensions omega", complex, about="C_L / alpha'' of each membrane wing", units="1"),
        "rigid": Column("omega", complex, about="C_L / alpha'' of the wing with its membrane held flat", units="1"),
        "growth": Column("tensions", about="largest growth rate about rest, U/c", units="1"),
    },
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftResponse(ReadOnlyArrays, Tabular):
    """First-harmonic lift per pitching acceleration, C_L / alpha'', of linear membrane wings and of the rigid wing.

    Attributes
    ----------
    omega : ndarray, shape (n_omega,)
        Angular frequencies, U/c.
    tensions : ndarray, shape (n_tensions,)
        Tensions c_T = 2 Eh delta0 at rest.
    membrane : ndarray of complex, shape (n_tensions, n_omega)
        C_L / alpha'' of each membrane wing.
    rigid : ndarray of complex, shape (n_omega,)
        C_L / alpha'' of the wing with its membrane held flat.
    growth : ndarray, shape (n_tensions,)
        Largest growth rate of each wing about rest. Where it is positive the steady response is not reached.
    """

    omega: Array
    tensions: Array
    membrane: ComplexArray
    rigid: ComplexArray
    growth: Array

    def plot(self, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the gains in decibels over log omega, a line a tension; see `hbnlp.plot.plot_lift_response`."""
        from hbnlp.plot import plot_lift_response

        return plot_lift_response(self, ax=ax, **options)

    def to_frd(self) -> control.FrequencyResponseData:
        """Return the response as a ``control.FrequencyResponseData`` from pitching acceleration to lift.

        Its input is ``alpha_acceleration``; its outputs are ``C_L_1``, ``C_L_2``, ... of the tensions in their order,
        and ``C_L_rigid`` of the rigid wing.

        Raises
        ------
        ImportError
            If the package ``control`` is not installed (extra ``hbnlp[control]``).
        """
        package = from_extra("control", "control", "a control.FrequencyResponseData")
        names = [*(f"C_L_{k + 1}" for k in range(self.tensions.size)), "C_L_rigid"]
        values = np.vstack([self.membrane, self.rigid])[:, np.newaxis]
        return package.FrequencyResponseData(values, self.omega, inputs=["alpha_acceleration"], outputs=names)

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, axes=("omega", "tensions"))

    def __repr__(self) -> str:
        tensions = ", ".join(
            f"{c:g}" + ("" if g < 0.0 else " (unstable)") for c, g in zip(self.tensions, self.growth, strict=True)
        )
        return (
            f"LiftResponse: {self.omega.size} frequencies from {self.omega.min():g} to {self.omega.max():g}\n"
            f"  c_T = {tensions}, and rigid"
        )


@interrupts_kept()
@renamed_arguments()
def lift_response(
    wing: System, omega: ArrayLike, *, tensions: ArrayLike, at: Mapping[str, float] | None = None
) -> LiftResponse:
    """Return the linear frequency response C_L / alpha'' of a wing for several tensions, beside the rigid wing.

    Parameters
    ----------
    wing : System
        A wing from `hbnlp.membrane_wing`, which pitches.
    omega : array_like, shape (n_omega,)
        Angular frequencies, positive, U/c.
    tensions : array_like, shape (n_tensions,)
        Values of c_T = 2 Eh delta0, reached by the prestrain at the wing's stiffness.
    at : mapping of parameter names to values, optional
        Overrides of the wing's values. A ``pitch_amplitude`` that is not given here is one: the response is linear.

    Raises
    ------
    ValueError
        If a frequency or a tension is not positive, if the wing does not pitch, or if it is no membrane wing.
    """
    instance_of("wing", wing, System, "a wing made by hbnlp.membrane_wing")
    wing.parameters.values(at, but=(OMEGA,))
    names = set(wing.parameters.names)
    if not {"stiffness", "prestrain"} <= names or not {"C_L", "alpha_acceleration"} <= set(wing.output_names):
        raise ValueError(f"{wing.name!r} is no membrane wing; give one made by hbnlp.membrane_wing")
    frequencies = np.array([real_number("omega", w, above=0.0) for w in finite_numbers("omega", omega)])
    values = np.array([real_number("tensions", c, above=0.0) for c in finite_numbers("tensions", tensions)])
    given = dict(at or {})
    if "pitch_amplitude" in names:
        given.setdefault("pitch_amplitude", 1.0)
    stiffness = given.get("stiffness", wing.parameters.defaults["stiffness"])
    acceleration = linear_response(wing, "alpha_acceleration", frequencies, at=given, held=True)
    if np.any(acceleration == 0.0):
        raise ValueError(
            "the wing does not pitch, so C_L / alpha'' has no value; give a pitch_amplitude that is not zero"
        )
    cases = [{**given, "prestrain": c / (2.0 * stiffness)} for c in values]
    return LiftResponse(
        omega=frequencies,
        tensions=values,
        membrane=np.array([linear_response(wing, "C_L", frequencies, at=case) for case in cases]) / acceleration,
        rigid=linear_response(wing, "C_L", frequencies, at=given, held=True) / acceleration,
        growth=np.array([eigenvalues(wing, case)[0].real for case in cases]),
    )
