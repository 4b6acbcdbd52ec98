"""The nodes of the quadruped; their computations are in separate modules."""
