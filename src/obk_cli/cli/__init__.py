"""The command line: one module per verb; nothing imports it."""
