"""Sweeps: run closed-loop tests for many seeds and parameter values, in many processes."""
