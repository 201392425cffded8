"""What every room rests on: array types, errors, checks, enumerations, storage, long work, compiled functions."""
