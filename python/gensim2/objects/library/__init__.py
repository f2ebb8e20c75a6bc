"""Object libraries: readers of the release's folder layout, the cache of prepared objects, export and import."""
