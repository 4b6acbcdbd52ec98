"""The `obk` tool: read a config, check it, lower it to a plan, launch it."""
