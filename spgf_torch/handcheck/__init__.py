"""Whether a hand is what its description says, before anything is tried with it; and descriptions for bare URDFs.

`check` has what geometry tells in a fraction of a second, `standing` what takes a simulation, `proposal` writes a
description from a URDF, `picture` and `page` draw each preshape.
"""
