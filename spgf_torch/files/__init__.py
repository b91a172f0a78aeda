"""Files: bounded readers (`reading`, `parquet`, `mesh_files`, `ply`), atomic writers (`writing`), digests (`sealing`).

`checks` are what readers of records share; `given` asks whether what the settings name is there at all.
"""
