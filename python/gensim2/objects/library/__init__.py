"""Object libraries: readers for the GenSim2 release's folder layout, a cache of prepared objects, export and import."""
