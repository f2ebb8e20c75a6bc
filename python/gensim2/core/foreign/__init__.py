"""Read untrusted files: exports, data sets, object libraries and records.

All untrusted files are read through this package. The package opens only regular files of limited size inside their
folder, accepts only single words as names, and passes only plain arrays of limited size to libraries. Libraries that
can still crash run in a subprocess. docs/reliability.md lists the checks of each reader.

| module | checks |
|---|---|
| ``tree`` | folders: links, special files, sizes, counts, depth |
| ``names`` | names of tasks, strategies, objects, cameras, columns |
| ``hdf5`` | groups and arrays of an HDF5 file |
| ``geometry`` | XML and meshes of robots and objects |
| ``archive`` | zip archives of tasks |
| ``library`` | exceptions raised by third-party libraries |
| ``process`` | memory, CPU time and crashes of a reader |
"""
