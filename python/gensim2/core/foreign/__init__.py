"""Read untrusted files: exports, data sets, object libraries and records.

All untrusted files are read through this package. A file is opened only if it is a regular file of limited size inside
its folder. Names in files, such as names of tasks, must be single words. Third-party libraries get only plain arrays of
limited size. If a library can crash in spite of these checks, it reads the file in a subprocess. docs/reliability.md
lists the checks of each reader.

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
