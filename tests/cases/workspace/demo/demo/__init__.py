"""A package whose nodes cannot be known from their source."""
