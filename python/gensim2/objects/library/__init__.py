"""Readers and writers of objects: libraries, the released layout, the cache of what is prepared, export, import."""
