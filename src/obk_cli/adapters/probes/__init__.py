"""Probes: each looks at one thing of this machine and gives its facts, for `obk doctor`."""
