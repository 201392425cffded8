"""Which outputs take the same samples: those that are polynomials of the motion, and all others."""

from __future__ import annotations

import warnings

import casadi as ca

from hbnlp.balance.sampling import OUTPUT_SAMPLES
from hbnlp.core.errors import AliasingWarning
from hbnlp.core.kept import by_one_thread
from hbnlp.systems.spectrum import Spectrum, spectra
from hbnlp.systems.switches import switches
from hbnlp.systems.system import System

TAU = 4
"""The place of the phase among the arguments of the outputs, behind q, q', q'' and x."""


@by_one_thread
def alike_outputs(system: System) -> list[tuple[Spectrum | None, list[int], ca.Function]]:
    """Return the outputs that take the same samples: their spectrum, their indices, and the function of just these.

    They are at most two: outputs that are polynomials of the motion, with the largest of their degrees and harmonics,
    and all others, for which the spectrum is None.
    """
    arguments = arguments_of_outputs(system)
    values = system.outputs(*arguments)
    each = spectra(system.outputs, TAU, range(TAU))[0]
    result: list[tuple[Spectrum | None, list[int], ca.Function]] = []
    known = [i for i, spectrum in enumerate(each) if spectrum is not None]
    others = [i for i, spectrum in enumerate(each) if spectrum is None]
    for indices in (known, others):
        if not indices:
            continue
        read = [spectrum for i in indices if (spectrum := each[i]) is not None]
        largest = Spectrum(max(e.degree for e in read), max(e.highest for e in read)) if read else None
        result.append((largest, indices, ca.Function("outputs", arguments, [ca.densify(values[indices])])))
    return result


@by_one_thread
def derivative_by_lags(function: ca.Function) -> ca.Function | None:
    """Return the derivative of outputs by x, a function of the parameters, or None where it varies with the motion.

    None as well where they switch with x: a step has the derivative zero.
    """
    arguments = [ca.SX.sym("argument", function.size1_in(i)) for i in range(function.n_in())]
    values, lags = function(*arguments), arguments[TAU - 1]
    derivative = ca.jacobian(values, lags)
    if ca.depends_on(derivative, ca.vertcat(*arguments[: TAU + 1])) or ca.depends_on(switches(values), lags):
        return None
    return ca.Function("by_lags", [arguments[-1]], [derivative])


@by_one_thread
def warn_of_switches(system: System, name: str) -> None:
    """Warn where an output has switches, whose places a program does not know."""
    index, arguments = system.output_index(name), arguments_of_outputs(system)
    if switches(system.outputs(*arguments)[index]).numel():
        warnings.warn(
            f"output {name!r} switches, and a program takes its harmonics from {OUTPUT_SAMPLES} samples: those of a "
            "kink are exact to about 1e-6 of its size, of a step to 5e-4 of its height for each time it is passed in a "
            "period; those of solutions and branches are exact",
            AliasingWarning,
            stacklevel=3,
        )


def arguments_of_outputs(system: System) -> list[ca.SX]:
    """Return new symbols for q, q', q'', x, tau and the parameters."""
    return [ca.SX.sym("argument", system.outputs.size1_in(i)) for i in range(system.outputs.n_in())]
