"""Learn grasping affordances from local shape: Sliced Pineapple Grid Features and shape-grasp particles.

After Thomsen, Kraft, Krueger: A Semi-local Surface Feature for Learning Successful Grasping Affordances (2016).
"""

import os

__version__ = "0.1.0"

# OpenMP threads that spin while they wait make torch many times slower as soon as another process needs the
# core; these take effect only before torch is imported, and only where the user has not set them.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")
