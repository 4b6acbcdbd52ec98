"""Bring up, supervise and shut down the nodes of a plan."""
