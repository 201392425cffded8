"""What was importable under another name: the new one, for attributes of packages and for imports alike."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from types import ModuleType

from hbnlp.core.renamed import renamed_name

_NAMES = {
    "hbnlp": {
        "ResolvedBranch": "hbnlp.Branch, which has n_harmonics and truncation_error of each point where it was traced "
        "with HarmonicBalance(system, tolerance=1e-4)",
        "TraceError": "hbnlp.TaskError, whose 'result' was 'branch'",
        "fold_curve": "hbnlp.follow(fold, 'force', span=..., limits=...)",
        "load_branch": "hbnlp.Branch.load(path, problem=...)",
        "resolve_harmonics": "hbnlp.trace(hbnlp.HarmonicBalance(system, tolerance=1e-4), name, span)",
    },
    "hbnlp.plot": {"plot_resolved": "branch.plot(output, color='n_harmonics')"},
    "hbnlp.stability": {"monodromy": "hbnlp.floquet(solution).monodromy"},
    "hbnlp.dns": {
        "plot": "hbnlp.plot.animate, plot_vorticity or plot_loads",
        "ForceLaw": "hbnlp.dns.Structure",
        "Restoring": "hbnlp.dns.Structure",
        "LinearTension": "hbnlp.dns.Membrane(hbnlp.LinearMembrane(...))",
        "NonlinearTension": "hbnlp.dns.Membrane(hbnlp.NonlinearMembrane(...))",
    },
}

_MODULES = frozenset(
    word
    for line in (
        "aeroelastic assembly bifurcations branch branchpoints callbacks checks collocation crossing curves errors",
        "firstorder foldcurves folds integrators interrupts lags linear_balance linear_response linear_stability",
        "linearisation marching membrane newton newtonmarch parameters peaks recording resolution sampling search",
        "solution solve storage sweep switching system timemarch timeresponse timesweep trace tracer truncation",
    )
    for word in line.split()
)
"""Modules of the time when all lay in one folder. Some are verbs of `hbnlp` now, which stay attributes."""

_ROOMS = (
    "'from hbnlp import ...' for the names in hbnlp.__all__; where other modules are, docs/how_it_is_built.md tells"
)


def old_names(package: str) -> Mapping[str, str]:
    """Return what to write instead of each old name of a package."""
    modules = dict.fromkeys(_MODULES, _ROOMS) if package == "hbnlp" else {}
    return modules | _NAMES.get(package, {})


class _OldImports:
    """A finder that finds nothing: asked after all others, it raises for an import of an old name.

    A package's ``__getattr__`` is not enough: ``from hbnlp import old`` drops its message, ``import hbnlp.old`` does
    not ask it.
    """

    @staticmethod
    def find_spec(fullname: str, *_more: Sequence[str] | ModuleType | None) -> None:
        package, _, name = fullname.rpartition(".")
        names = old_names(package)
        if name in names and names[name] is _ROOMS:
            raise ImportError(f"{fullname} is no module any more: write {_ROOMS}", name=fullname)
        if name in names:
            raise ImportError(str(renamed_name(package, name, names)), name=fullname)


def announce_old_imports() -> None:
    """Make imports of old names say the new ones."""
    if _OldImports not in sys.meta_path:
        sys.meta_path.append(_OldImports)
