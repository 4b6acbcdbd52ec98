"""A running stack as one value, and the terminal that shows it."""
