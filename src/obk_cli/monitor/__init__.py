"""A running stack as a value, and the terminal view of it."""
