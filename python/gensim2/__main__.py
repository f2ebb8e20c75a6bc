"""Run the command line, so that ``python -m gensim2`` does the same as ``gensim2``."""

from gensim2.cli.main import main

main()
