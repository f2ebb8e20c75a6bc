"""Read untrusted files: exports, data sets, object libraries and records.

All untrusted files are read through this package. The package opens a file only if the file is a regular file of
limited size inside its folder. It accepts names in files, such as names of tasks, only if they are single words. It
passes only plain arrays of limited size to third-party libraries. A library that can crash in spite of these checks
reads the file in a subprocess. docs/reliability.md lists the checks of each reader.

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
