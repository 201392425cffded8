"""One task at many points: a grid or a list of values, here or by many workers."""
