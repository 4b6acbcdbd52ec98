"""Analyze a node's Python source without importing or running it."""
