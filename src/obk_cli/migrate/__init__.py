"""One spelling of a config into the other: edits of the user's text, never a new text."""
