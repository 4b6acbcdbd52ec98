"""Read what a node's Python source defines, without importing or running it."""
