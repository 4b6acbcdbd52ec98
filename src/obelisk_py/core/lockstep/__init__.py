"""Nodes in lock-step: one process, simulated time, every event in an exact order."""
