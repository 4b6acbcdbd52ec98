"""Runs of this host: their folders, which of them are alive, and how to talk to their launchers."""
