"""Utilities for nodes: spinning, transitions, and arrays in messages."""
