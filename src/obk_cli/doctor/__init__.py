"""Checks of this machine for `obk doctor`: a module a subject, with facts, probe and judge."""
