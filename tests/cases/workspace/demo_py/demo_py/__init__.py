"""A package whose nodes are known from their source."""
