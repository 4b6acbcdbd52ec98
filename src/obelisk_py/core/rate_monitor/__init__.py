"""Monitor the rates of timers and sensor groups, and report them on `/diagnostics`."""
