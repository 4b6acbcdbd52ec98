"""Read the text of a config into a typed stack in which each value has its location."""
