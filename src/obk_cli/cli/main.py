"""Where `obk` begins, and ends without a word when it is interrupted.

Whatever takes time is imported within `main`: Ctrl-C before it would show a traceback.
"""

import sys
from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `obk` and end the process with its exit code."""
    try:
        from obk_cli.cli.commands import run

        run(arguments)
    except KeyboardInterrupt:
        from obk_cli.errors import EXIT_INTERRUPTED

        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
