"""What every random system is held to; each check compares with numbers that are not the package's."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from independent import FirstOrder
from random_oscillators import RandomOscillator
from sampled_balance import SampledBalance
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

import hbnlp
from hbnlp.testing import check_branch

RESIDUAL_TOL = 1e-7
FOLD_TOL = 1e-6
MULTIPLIER_TOL = 1e-5
SPECIAL_TOL = 1e-6
RESOLVED = 1e-6
"""Motions of which the harmonics leave out less are held to direct integration; a truncated one is no motion."""


@dataclass
class Report:
    """How often each check was made, what was left out and why, and what failed: (kind, what)."""

    checks: Counter = field(default_factory=Counter)
    left_out: Counter = field(default_factory=Counter)
    failures: list[tuple[str, str]] = field(default_factory=list)
    points: int = 0

    def hold(self, kind, holds, what):
        self.checks[kind] += 1
        if not holds:
            self.failures.append((kind, what))


def examine(oscillator: RandomOscillator, *, most_points: int = 1500) -> Report:
    """Trace a random system over its span and hold the branch to all there is."""
    report = Report()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", hbnlp.LinearInstabilityWarning)
        problem = oscillator.problem()
        method = hbnlp.PseudoArclength(max_points=most_points)
        parts = []

        def keep(progress):
            if progress.counts["points"] % 25 == 10 and not progress.done:
                parts.append(progress.result())

        try:
            branch = hbnlp.trace(problem, "omega", oscillator.span, method=method, callbacks=[keep])
        except hbnlp.ConvergenceError as error:
            report.failures.append(("no start", str(error)[:120]))
            return report
        report.points = len(branch)
        if branch.end is hbnlp.End.MAX_POINTS:
            report.left_out["longer than the most points"] += 1
        else:
            report.hold("reaches an end", branch.complete, f"{branch.end.name} at omega = {branch.parameter[-1]:.9g}")
        checks = [
            check_shapes,
            check_residual,
            check_folds,
            check_multipliers,
            check_stable,
            check_reversed,
            check_retraced,
        ]
        if parts:
            checks.append(partial(check_resumed, parts[2 * len(parts) // 3]))
        for check in checks:
            try:
                check(report, oscillator, problem, branch)
            except Exception as error:  # noqa: BLE001 (a long run goes on, and tells)
                report.failures.append(
                    (
                        getattr(check, "func", check).__name__.removeprefix("check_"),
                        f"{type(error).__name__}: {error}"[:200],
                    )
                )
    return report


def examine_to_a_tolerance(oscillator: RandomOscillator, tolerance: float, *, most_harmonics: int = 63) -> Report:
    """Trace a random system to a tolerance and hold its special points to those of other ways to the same branch."""
    report = Report()
    system = oscillator.problem().system
    problem = hbnlp.HarmonicBalance(system, tolerance=tolerance, most_harmonics=most_harmonics)
    parts = []

    def keep(progress):
        if progress.counts["points"] % 25 == 10 and not progress.done:
            parts.append(progress.result())

    def same(kind, one, other):
        there, here = _differ(_values(one), _values(other), 5.0 * tolerance)
        report.hold(kind, not there and not here, f"only one {there}, only the other {here}, ends {other.end.name}")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", hbnlp.LinearInstabilityWarning)
        branch = hbnlp.trace(problem, "omega", oscillator.span, callbacks=[keep])
        report.points = len(branch)
        check_shapes(report, oscillator, problem, branch)
        report.hold("reaches an end", branch.complete, branch.message)
        if branch.n_harmonics.max() < most_harmonics:
            report.hold("error", branch.truncation_error.max() <= tolerance, f"{branch.truncation_error.max():.1e}")
            report.hold("converged", all(point.converged for point in branch.special_points), branch.special_points)
            more = hbnlp.HarmonicBalance(system, int(branch.n_harmonics.max()) + 6)
            same("fixed number", branch, hbnlp.trace(more, "omega", oscillator.span))
        if branch.end is hbnlp.End.SPAN_END:
            last = branch.solution(len(branch) - 1)
            same("reversed", branch, hbnlp.trace(problem, "omega", oscillator.span[::-1], start=last))
        if parts:
            same("resumed", branch, hbnlp.trace(problem, "omega", oscillator.span, resume=parts[2 * len(parts) // 3]))
    return report


def _sample(branch, count, oscillator):
    rng = np.random.default_rng(oscillator.seed)
    return sorted(rng.choice(len(branch), min(count, len(branch)), replace=False))


def check_shapes(report, _oscillator, _problem, branch):
    try:
        check_branch(branch)
        report.hold("check_branch", True, "")
    except AssertionError as error:
        report.hold("check_branch", False, str(error))


def check_residual(report, oscillator, _problem, branch):
    balance = SampledBalance(oscillator)
    for i in _sample(branch, 20, oscillator):
        x, w = branch.coefficients[i].ravel(), branch.parameter[i]
        balance = balance.resolving(x, w)
        size = max(balance.term_size(x, w), 1e-9 * oscillator.units[2])
        relative = np.abs(balance.residual(x, w)).max() / size
        report.hold("residual", relative <= RESIDUAL_TOL, f"{relative:.1e} at omega = {w:.9g}")


def check_folds(report, oscillator, _problem, branch):
    balance = SampledBalance(oscillator)
    for fold in branch.folds[:6]:
        if not fold.refined:
            report.hold("fold refined", False, f"not at omega = {fold.value:.9g}")
            continue
        x = fold.solution.coefficients.ravel()
        balance = balance.resolving(x, fold.value)
        value = balance.fold(x, fold.value)
        close = value is not None and abs(value - fold.value) <= FOLD_TOL * fold.value
        report.hold("fold", close, f"{fold.value:.12g}, by Newton's method {value}")


def check_multipliers(report, oscillator, problem, branch):
    """The variational equations along the balance's own motion: truncation plays no part."""
    balance = SampledBalance(oscillator)
    size = problem.system.n_state
    n, (a, b, out) = balance.n, balance.lags
    inverse = np.linalg.inv(balance.mass)
    scale = np.concatenate([np.ones(n), np.full(n + len(a), 1.0 / oscillator.units[1])])  # of q, q', x
    for i in _sample(branch, 2, oscillator):
        x, w = branch.coefficients[i], branch.parameter[i]
        if not branch.stability_converged[i]:
            report.left_out["multipliers that are said not to converge"] += 1
            continue

        def rate(tau, z, x=x, w=w):
            waves = balance.waves_at(tau)[0]
            q, v = (x @ waves)[:, None], (w * (x @ balance.rate.T) @ waves)[:, None]
            by_q, by_v = balance.slopes(q, v, np.array([tau]))
            top = inverse @ np.hstack(
                [-balance.stiffness - by_q[..., 0], -balance.damping - by_v[..., 0], out.reshape(n, -1)]
            )
            matrix = np.zeros((size, size))
            matrix[:n, n : 2 * n] = np.eye(n)
            matrix[n : 2 * n] = top
            matrix[2 * n :] = b @ top
            matrix[2 * n :, 2 * n :] += a
            matrix = matrix * scale / scale[:, None] / w
            return (matrix @ z.reshape(size, size)).ravel()

        run = solve_ivp(
            rate, (0.0, 2.0 * np.pi), np.eye(size).ravel(), method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.1
        )
        values = np.linalg.eigvals(run.y[:, -1].reshape(size, size))
        given = list(branch.multipliers[i])
        worst = 0.0
        for value in values[np.argsort(-np.abs(values))]:
            nearest = int(np.argmin(np.abs(np.array(given) - value)))
            worst = max(worst, abs(given.pop(nearest) - value))
        worst /= max(1.0, np.abs(values).max())
        # two multipliers that meet move as the root of an error
        apart = min((abs(p - q) for k, p in enumerate(values) for q in values[:k]), default=1.0)
        bound = MULTIPLIER_TOL * max(1.0, min(0.1 / max(apart, 1e-9), 1e2))
        report.hold("multipliers", worst <= bound, f"off by {worst:.1e} at omega = {w:.9g}")


def check_stable(report, oscillator, problem, branch):
    balance = SampledBalance(oscillator)
    stable = np.flatnonzero(branch.stable)
    if not stable.size:
        return
    i = int(stable[np.random.default_rng(oscillator.seed).integers(stable.size)])
    x, w = branch.coefficients[i].ravel(), branch.parameter[i]
    if balance.resolving(x, w).left_out(x, w) > RESOLVED:
        report.left_out["stable motions that are truncated"] += 1
        return
    first_order = FirstOrder(problem.system, {"omega": w})
    scale = np.concatenate(
        [
            np.full(balance.n, oscillator.units[0]),
            np.full(balance.n + len(balance.lags[0]), oscillator.units[0] / oscillator.units[1]),
        ]
    )
    y = balance.state(x, w) / scale

    def rate(tau, z):
        return first_order(tau / w, z * scale) / scale / w

    run = solve_ivp(rate, (0.0, 6.0 * np.pi), y, method="DOP853", rtol=1e-10, atol=1e-12)
    off = np.abs(run.y[:, -1] - y).max() / max(np.abs(y).max(), 1e-2)
    report.hold("stable motion", off <= 1e-4, f"off by {off:.1e} after three periods at omega = {w:.9g}")


def _values(branch):
    return sorted((point.kind.code, point.value) for point in branch.special_points)


def _differ(one, other, tol=SPECIAL_TOL):
    """The special points of either that have no equal in the other."""
    rest, lonely = list(other), []
    for kind, value in one:
        near = [p for p in rest if p[0] == kind and abs(p[1] - value) <= tol * value]
        if near:
            rest.remove(near[0])
        else:
            lonely.append((kind, float(value)))
    return lonely, [(kind, float(value)) for kind, value in rest]


def check_reversed(report, oscillator, problem, branch):
    if branch.end is not hbnlp.End.SPAN_END:
        report.left_out["reversed: does not end at the span's end"] += 1
        return
    last = branch.solution(len(branch) - 1)
    back = hbnlp.trace(
        problem, "omega", oscillator.span[::-1], start=last, method=hbnlp.PseudoArclength(max_points=6000)
    )
    there, here = _differ(_values(branch), _values(back))
    report.hold("reversed", not there and not here, f"only forward {there}, only back {here}, ends {back.end.name}")


def check_resumed(part, report, oscillator, problem, branch):
    if not branch.complete:
        return
    whole = hbnlp.trace(problem, "omega", oscillator.span, resume=part)
    there, here = _differ(_values(branch), _values(whole))
    size = np.abs(branch.coefficients).max()
    off = np.abs(whole.coefficients[-1] - branch.coefficients[-1]).max() / max(size, 1e-300)
    alike = whole.end is branch.end and (off <= 1e-5 or size <= 1e-9 * oscillator.units[0])
    report.hold(
        "resumed",
        alike and not there and not here,
        f"{whole.end.name} for {branch.end.name}, off by {off:.1e}, only at once {there}, only resumed {here}",
    )


def check_retraced(report, _oscillator, _problem, branch):
    """No point lies on the cubic through distant points of the branch and runs along with it."""
    flat = branch.coefficients.reshape(len(branch), -1)
    size = max(np.abs(flat).max(), 1e-300)
    y = np.column_stack([flat / size, branch.parameter / max(branch.span)])
    steps = np.diff(y, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    last = len(y) - 1
    for i in range(1, last - 1):
        others = np.flatnonzero(np.abs(np.arange(last + 1) - i - 0.5) > 6)
        if branch.closed:
            others = others[(others > 6) & (others < last - 6)] if 6 < i < last - 6 else others[:0]
        away = y[others] - y[i]
        along = away @ steps[i] / lengths[i] ** 2
        off = np.linalg.norm(away - along[:, None] * steps[i], axis=1)
        near = others[(along > 0.0) & (along < 1.0) & (off < 0.1 * lengths[i])]
        if not near.size:
            continue
        nodes = np.concatenate([[0.0], np.cumsum(lengths[i - 1 : i + 2])])
        curve = BarycentricInterpolator(nodes, y[i - 1 : i + 3])(np.linspace(nodes[1], nodes[2], 201))
        for k in near[(near > 0) & (near < last)]:
            distances = np.linalg.norm(curve - y[k], axis=1)
            j = int(np.clip(np.argmin(distances), 1, 199))
            one, other = curve[j + 1] - curve[j - 1], y[k + 1] - y[k - 1]
            cosine = abs(one @ other) / (np.linalg.norm(one) * np.linalg.norm(other))
            if distances[j] < 5e-3 * lengths[i] and cosine > 0.999:
                report.hold("retraced", False, f"points {i} and {k} at omega = {branch.parameter[k]:.9g}")
                return
    report.hold("retraced", True, "")
