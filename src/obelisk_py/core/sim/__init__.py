"""Simulators that replace the robot."""
