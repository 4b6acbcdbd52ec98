"""Who has a name of a package or module already, for tests of names."""


def no_owner(_name: str) -> str | None:
    """Every name is free."""
    return None
