"""Array aliases and the errors of the flow solver."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FlowError(RuntimeError):
    """A run that cannot go on: what happened, the value, the limit and the remedy."""
