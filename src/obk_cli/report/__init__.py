"""Findings for a person or a program: one bag, several voices. Each returns its text."""
