"""``python -m gensim2.cli`` is ``gensim2``."""

from gensim2.cli.main import main

main()
