"""Many harmonics take memory as their Jacobian does."""

import math
import subprocess
import sys

import pytest

SCRIPT = """
import hbnlp

system = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=50.0)
solution = hbnlp.solve(hbnlp.HarmonicBalance(system, n_harmonics=301), at={"omega": 6.0})
multipliers = hbnlp.floquet(solution).multipliers
print(abs(solution.harmonics("x")[1]), abs(multipliers.prod()), hbnlp.truncation_error(solution))
"""
# Linux counts what the parent held as the peak of a process that it starts: a small one stands between
BETWEEN = """
import resource, subprocess, sys

subprocess.run([sys.executable, "-c", sys.argv[1]], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="the module resource is of Unix")
def test_three_hundred_harmonics_stay_below_three_tenths_of_a_gigabyte():
    command = [sys.executable, "-c", BETWEEN, SCRIPT]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240)
    first, determinant, error, peak = map(float, done.stdout.split())
    assert first == pytest.approx(1.500922787, abs=1e-9)
    assert determinant == pytest.approx(math.exp(-0.1 * 2.0 * math.pi / 6.0), rel=1e-9)
    assert error < 1e-10
    assert 0.05e9 < peak < 0.3e9
