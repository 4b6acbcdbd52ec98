"""Findings with their locations, the edits that fix them, and the rules."""
