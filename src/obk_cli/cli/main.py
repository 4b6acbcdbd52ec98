"""Entry point of `obk`; Ctrl-C stops it without a traceback at any time.

Only `main` imports other modules, so that Ctrl-C during an import is caught too.
"""

import gc
import sys
from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `obk` and exit with its exit code."""
    # With the default of 700, the collector examines all imported objects many times over.
    gc.set_threshold(50_000)
    try:
        from obk_cli.process.signals import insist_on_interrupt

        with insist_on_interrupt():
            from obk_cli.cli.commands import run

            run(arguments)
    except KeyboardInterrupt:
        from obk_cli.errors import EXIT_INTERRUPTED

        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:  # raised by an import: a library is incompatible
        from obk_cli.errors import pythonpath_shadow

        shadow = pythonpath_shadow(error)
        if shadow is None:
            raise
        sys.exit(f"error: {type(error).__name__}: {error}: {shadow}\n  help: unset PYTHONPATH")


if __name__ == "__main__":
    main()
