"""Clutter: tables full of things are sensed, a grasp is planned and tried in SAPIEN, round after round.

The protocol is the field's (VGN, Breyer 2020; GIGA, Jiang 2021): a scene is attempted until it is clear, no grasp is
found, or grasps fail twice in a row. Beside ours, methods without learning and Contact-GraspNet plan on the same
scenes.
"""
