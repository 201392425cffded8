"""Direct integration in time until a response repeats itself."""
