"""Run the command line: ``python -m gensim2`` is ``gensim2``."""

from gensim2.cli.main import main

main()
