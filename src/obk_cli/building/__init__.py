"""Compiling the message packages of a workspace into its overlay."""
