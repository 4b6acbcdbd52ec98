"""Edit a config's text: fix findings, migrate the syntax, add a node."""
