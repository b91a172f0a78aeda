"""A model kept warm behind HTTP: clouds, depth images and meshes in, grasps out, on this machine alone.

`server` binds, `app` has the routes, `bodies` takes what a request sends into files of its own, `predicting` runs in a
process of its own and answers; `client` is a file that can be copied to a robot. The paper has no part in this.
"""
