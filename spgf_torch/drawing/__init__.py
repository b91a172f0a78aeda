"""What all pictures and pages share (`style`, `page`), and what they show: grasps in a scene, rounds of clutter."""
