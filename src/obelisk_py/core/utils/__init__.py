"""Functions around a node: spinning it, and arrays in messages."""
