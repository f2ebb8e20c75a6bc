"""Run the ``gensim2`` command with ``python -m gensim2.cli``."""

from gensim2.cli.main import main

main()
