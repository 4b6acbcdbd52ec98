"""Rates as promises: ticks counted, their lateness, and a status a second on `/diagnostics`."""
