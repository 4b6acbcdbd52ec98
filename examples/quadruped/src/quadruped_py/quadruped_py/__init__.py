"""The nodes of the quadruped; what they compute stands in modules of its own."""
