"""What a workspace holds: packages, programs, compiled messages, robot models."""
