"""Files: bounded readers (`reading`, `parquet`, `mesh_files`, `ply`), atomic writers (`writing`), digests (`sealing`).

`checks` are what readers of records share; `given` checks that the files which the settings name exist.
"""
