"""Run nodes in lockstep: in one process, with simulated time and a defined order of events."""
