"""From the text of a config to a typed stack in which each value has its place."""
