"""Simulated RGB-D cameras around an object, their noise, and the surface patches (texlets) of what they see.

The paper's input (section 3.1, Eq. 1, and section 4: "Four RGB-D sensors ... surround the object").
A depth image of a real camera joins at `texlets.extract`.
"""
