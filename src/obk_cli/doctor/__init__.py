"""Checks for `obk doctor`; each module has the facts, probe and judge of a subject."""
