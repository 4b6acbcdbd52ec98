"""Findings as text for the terminal, JSON, GitHub annotations or SARIF."""
