"""The example controller of the two-link robot."""
