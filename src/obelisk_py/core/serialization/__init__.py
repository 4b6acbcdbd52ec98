"""Serialize messages to the wire format (CDR) and back."""
