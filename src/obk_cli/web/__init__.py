"""A running stack as a page: what it is told, what it may ask, who may ask it."""
