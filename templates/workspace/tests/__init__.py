"""Tests of the stack as a whole; a package, so that its modules may be named like those in src."""
