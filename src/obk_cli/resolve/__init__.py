"""Many trees into one: includes, merge, `${VAR}`, `--set`, paths. Every value keeps its place."""
