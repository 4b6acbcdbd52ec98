"""Ready-made controllers."""
