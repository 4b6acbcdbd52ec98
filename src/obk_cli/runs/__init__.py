"""Runs on this host: their folders, which ones are alive, and communication with launchers."""
