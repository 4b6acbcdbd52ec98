"""The `obk` tool: reads a config, checks it, lowers it to a plan, launches it."""
