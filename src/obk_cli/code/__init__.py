"""Reading Python source for what it says of a node; nothing of it is imported or run."""
