"""What a node's Python source says of the node; nothing of it is imported or run."""
