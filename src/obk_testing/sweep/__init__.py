"""Sweeps: run closed-loop tests across many seeds and parameter values, in many processes."""
