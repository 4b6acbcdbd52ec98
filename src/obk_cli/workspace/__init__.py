"""The contents of a workspace: packages, programs, compiled messages, robot models."""
