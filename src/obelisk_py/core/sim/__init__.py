"""Simulators that stand in for the robot."""
