"""A new node joins a config: wired to the topics that are there, put into the user's text."""
