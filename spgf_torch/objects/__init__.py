"""Rigid objects: what the experiment grasps (paper, section 5).

The fifty described objects of `data/objects` (`library`, built by `shapes` and `lofts`) and folders of scanned meshes
as they lie on disk (`folders`) become the same record, `grasp_object.GraspObject`: surface, exact convex pieces, mass,
inertia.
"""
