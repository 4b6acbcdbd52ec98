"""Ready-made nodes."""
