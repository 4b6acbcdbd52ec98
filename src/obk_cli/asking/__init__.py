"""Asking running stacks: the library behind `obk lifecycle`, `obk ps`, `obk stop`, `obk logs`."""
