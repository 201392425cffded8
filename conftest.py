"""What has to be set before the test workers start and import numpy."""

import os

# Matrices of some hundred rows, one worker a core: BLAS threads on top of that would only wait for each other.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
