"""The error of the flow solver."""


class FlowError(RuntimeError):
    """A run that cannot go on: what happened, the value, the limit and the remedy."""
