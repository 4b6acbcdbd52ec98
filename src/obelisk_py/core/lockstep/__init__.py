"""Run nodes in lock-step: in one process, with simulated time and a defined order of events."""
