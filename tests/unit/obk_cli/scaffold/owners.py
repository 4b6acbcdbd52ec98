"""Owners of the names of packages and modules, for tests of names."""


def no_owner(_name: str) -> str | None:
    """Every name is free."""
    return None
