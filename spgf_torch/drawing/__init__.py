"""What all pictures and pages share (`style`, `page`); grasps in a scene as picture, page, table; clutter as page, film."""
