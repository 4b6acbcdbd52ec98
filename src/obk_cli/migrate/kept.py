"""What stays as it was, said with its place."""

from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import Span

__all__ = ["kept"]


def kept(message: str, span: Span, help: str | None = None) -> Diagnostic:
    """A finding about something that cannot be rewritten; no fault of the config."""
    return Diagnostic(code="migrate", severity="info", message=message, span=span, help=help)
