"""Ready-made estimators."""
