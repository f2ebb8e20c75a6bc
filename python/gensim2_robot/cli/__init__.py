"""Commands of ``gensim2 robot``."""
