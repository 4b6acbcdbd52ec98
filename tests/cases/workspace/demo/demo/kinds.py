"""Chooses classes of nodes at run time, which static analysis cannot know."""

import importlib


def node_type(kind: str) -> type:
    return importlib.import_module(f"demo.{kind}_node").Node
