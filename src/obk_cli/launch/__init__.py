"""Bringing a plan's nodes up in order, watching them, and bringing them down."""
