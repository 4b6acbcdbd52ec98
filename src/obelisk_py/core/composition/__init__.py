"""Nodes of several programs in one process, on one executor: `python -m` this, and a file."""
