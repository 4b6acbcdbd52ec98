"""Findings with their places, the edits that fix them, and the rules."""
