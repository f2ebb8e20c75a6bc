"""The boundary to files of others: exports, data sets, libraries and records that a stranger may have made.

Every reader of such files goes through here. A file is opened only where it is a regular one of bounded size that no
link leads out of its folder; names are single words; libraries are handed plain arrays of bounded size; and what can
still end a process is read in a process of its own (docs/reliability.md lists what each reader checks).

| module | checks |
|---|---|
| ``tree`` | folders: links, special files, sizes, counts, depth |
| ``names`` | names of tasks, strategies, objects, cameras, columns |
| ``hdf5`` | groups and arrays of an HDF5 file |
| ``geometry`` | XML and meshes of robots and objects |
| ``archive`` | a zip archive of tasks |
| ``library`` | what libraries raise |
| ``process`` | memory, CPU time and death of a reader |
"""
