"""The Sliced Pineapple Grid Feature once more, as loops in float64 that follow the paper line by line.

Slow and obvious: one centre at a time, the angles with acos as Eqs. 2-4 print them.
"""

import math

import numpy as np

RIGHT = math.pi / 2
SINGULAR, TIE = 1e-3, 1e-4


def relations(X1, frame, X2, n2):
    """(alpha1, alpha2, alpha3) of one neighbour; alpha3 is None where it lies along the normal (or at X1)."""
    R_x, R_y, n1 = frame.T
    d = X1 - X2
    length = np.linalg.norm(d)
    alpha2 = math.acos(np.clip(n1 @ n2, -1, 1))
    if length == 0 or np.linalg.norm(d - (d @ n1) * n1) <= SINGULAR * abs(d @ n1):
        return None, alpha2, None
    alpha1 = RIGHT - math.acos(np.clip(d @ n1 / length, -1, 1))
    return alpha1, alpha2, math.atan2(-d @ R_y, -d @ R_x)


def grid(X, n, frame, centre, radius, cells):
    """Cell means (2, cells, 2) with NaN where a cell is empty: steps 1 to 3."""
    members = [[[] for _ in range(cells)] for _ in range(2)]
    for other in range(len(X)):
        if other == centre or np.linalg.norm(X[other] - X[centre]) > radius:
            continue
        alpha1, alpha2, alpha3 = relations(X[centre], frame, X[other], n[other])
        if alpha3 is None:
            continue
        layer = 1 if alpha2 > RIGHT + SINGULAR else 0
        cell = math.floor(alpha3 / (2 * math.pi / cells) + 0.5) % cells
        members[layer][cell].append((alpha1, alpha2))
    means = np.full((2, cells, 2), np.nan)
    for layer in range(2):
        for cell in range(cells):
            if members[layer][cell]:
                means[layer, cell] = np.mean(members[layer][cell], axis=0)
    return means


def moving_average(means, half_length):
    """Step 4, on each layer and angle by itself."""
    cells = means.shape[1]
    out = np.full_like(means, np.nan)
    for layer in range(2):
        for cell in range(cells):
            total, weights = np.zeros(2), 0.0
            for other in range(cells):
                distance = min((cell - other) % cells, (other - cell) % cells)
                if distance <= half_length and not np.isnan(means[layer, other, 0]):
                    weight = (half_length + 1 - distance) / (half_length + 1)
                    total, weights = total + weight * means[layer, other], weights + weight
            if weights > 0:
                out[layer, cell] = total / weights
    return out


def encode_gaps(rings):
    saturated = np.array([[RIGHT, RIGHT], [RIGHT, math.pi]])
    encoded = np.where(np.isnan(rings), saturated[:, None], rings)
    encoded[0, :, 1] = np.minimum(encoded[0, :, 1], RIGHT)
    return encoded


def start_cell(rings):
    """Step 5 with our tie rule: walk along every run of maximal cells."""
    cells = rings.shape[1]
    curvature = rings[0, :, 1]
    tied = [value >= curvature.max() - TIE for value in curvature]
    runs = []  # (length, centre)
    for cell in range(cells):
        if tied[cell] and (not tied[cell - 1] or all(tied)):
            length = 1
            while length < cells and tied[(cell + length) % cells]:
                length += 1
            runs.append((length, (cell + (length - 1) // 2) % cells))
    widest = max(length for length, _ in runs)
    content = {centre: content_after(rings, centre) for length, centre in runs if length == widest}
    return next(centre for centre, value in content.items() if value >= max(content.values()) - TIE)


def content_after(rings, start):
    cells = rings.shape[1]
    return sum(rings[:, (start + k) % cells].sum() * math.exp(-k * 2 * math.pi / cells) for k in range(cells))


def spgf(X, n, frames, count, radius=0.03, cells=36, half_length=6):
    """Rings (count, 2, cells, 2), poses (count, 4, 4) and valid (count,) of the first `count` of the texlets X, n
    (N, 3) with reference frames (N, 3, 3)."""
    out = np.empty((count, 2, cells, 2)), np.tile(np.eye(4), (count, 1, 1)), np.empty(count, bool)
    for centre in range(count):
        means = grid(X, n, frames[centre], centre, radius, cells)
        rings = encode_gaps(moving_average(means, half_length))
        start = start_cell(rings)
        angle = start * 2 * math.pi / cells
        R_x, R_y, n1 = frames[centre].T
        x_axis = math.cos(angle) * R_x + math.sin(angle) * R_y
        out[0][centre] = np.roll(rings, -start, axis=1)
        out[1][centre, :3] = np.stack([x_axis, np.cross(n1, x_axis), n1, X[centre]], axis=1)
        out[2][centre] = not np.isnan(means[..., 0]).all()
    return out
