"""People's own data: point clouds, depth images and meshes, read, checked and made into texlets.

The paper's input is "a set of texlets" (section 3.1, Eq. 1); they are made from what a camera or CAD gives. Every
number of how is a key of `conf/scene`; texlets are thinned as `conf/sensing` says, so they look as the learned ones.
"""
