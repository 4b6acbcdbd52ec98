"""Analyse a node's Python source without importing or running it."""
