"""A running stack at a glance: what a terminal, a page and a program are shown of it."""
