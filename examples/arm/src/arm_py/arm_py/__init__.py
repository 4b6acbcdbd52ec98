"""The nodes of the arm; the law is in a module of its own."""
