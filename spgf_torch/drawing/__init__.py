"""What all pictures and pages share (`style`, `page`), and grasps in a scene as picture, page and table."""
