"""Files: bounded readers (`reading`, `parquet`, `mesh_files`, `ply`), atomic writers (`writing`), and `digests`.

`checks` are what readers of records share; `given_paths` checks that the files which the settings name exist.
"""
