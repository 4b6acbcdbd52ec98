"""A package whose package.xml is malformed; never run."""


def main() -> None:
    """Do nothing."""
