"""Command line of gensim2. Each command has a module and is generated from a typed function."""
