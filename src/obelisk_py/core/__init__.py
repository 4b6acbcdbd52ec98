"""The base classes of Obelisk nodes, their lifecycle and their components."""
