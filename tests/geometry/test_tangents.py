"""Directions along a surface."""

import numpy as np

from spgf_torch.geometry.tangents import tangents


def test_they_span_the_surface_whatever_its_normal() -> None:
    """Right-handed with the normal, also near the axis that it is crossed with; +x gives +y and +z."""
    normals = np.array([[1.0, 0, 0], [0, 0, 1], [0, 0, -1], [0.6, 0, -0.8], [0.1, 0.3, np.sqrt(0.9)]])
    u, v = tangents(normals)
    np.testing.assert_allclose(np.cross(u, v), normals, atol=1e-12)
    np.testing.assert_allclose([(u * u).sum(1), (v * v).sum(1), 1 + (u * v).sum(1)], 1, atol=1e-12)
    np.testing.assert_allclose([u[0], v[0]], [[0, 1, 0], [0, 0, 1]], atol=1e-12)
    assert tangents(normals[:0])[0].shape == (0, 3)
