"""The command line: one module a command, each a thin face of a typed function."""

from gensim2.cli.main import main

__all__ = ["main"]
