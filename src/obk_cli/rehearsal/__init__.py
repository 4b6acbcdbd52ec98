"""Rehearsal: a stack is started, its nodes are killed and frozen, and its rules are held to."""
