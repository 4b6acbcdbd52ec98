"""Edits of a config's text: fix findings, migrate the spelling, add a node."""
