"""Simulated RGB-D cameras around an object, their noise, and the surface patches (texlets) of what they see.

The paper's input (section 3, Eq. 1). Of its cameras Fig. 7a says: "Four RGB-D sensors, represented by the four frames,
surround the object". A depth image of a real camera joins at `texlets.extract`.
"""
