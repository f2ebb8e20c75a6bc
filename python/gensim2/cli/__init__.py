"""Command line of gensim2: one module for each command, generated from a typed function."""
