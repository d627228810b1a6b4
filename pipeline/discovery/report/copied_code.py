"""Functions of this package as the text of a program that does not need it."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np


def array_text(value: Any) -> str:
    """A number or an array as Python."""
    return f"np.array({np.asarray(value).tolist()!r})"


class CopiedCode:
    """Functions copied from their modules, without docstrings and annotations.

    The constants and functions of these modules that they use are copied with them.
    """

    def __init__(self) -> None:
        self._parts: dict[str, str] = {}

    @property
    def text(self) -> str:
        """The code; what is used stands before what uses it."""
        return "\n".join(self._parts.values())

    def copy(self, function: Callable[..., Any], name: str) -> str:
        """Add a function by another name, which is returned."""
        node = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        assert isinstance(node, ast.FunctionDef), f"{name}: a law is a function with a name"
        node.name, node.returns, node.decorator_list = name, None, []
        for argument in node.args.args:
            argument.annotation = None
        if ast.get_docstring(node) is not None:
            del node.body[0]
        names = function.__globals__
        for used in [n for n in ast.walk(node) if isinstance(n, ast.Name) and n.id in names and n.id != "np"]:
            value = names[used.id]
            if callable(value):
                self.copy(value, used.id)
            else:
                used.id = self._constant(used.id, array_text(value) if isinstance(value, np.ndarray) else repr(value))
        self.add(ast.unparse(node), name)
        return name

    def add(self, text: str, name: str = "") -> None:
        """Add code; with a name, once."""
        self._parts.setdefault(name or text, text)

    def _constant(self, name: str, value: str) -> str:
        """The name by which a constant stands in the code: of two by one name the second gets another."""
        while self._parts.get(name, f"{name} = {value}") != f"{name} = {value}":
            name += "_"
        self.add(f"{name} = {value}", name)
        return name
