"""Sweeps: run closed-loop tests for many seeds and values of parameters, in many processes."""
