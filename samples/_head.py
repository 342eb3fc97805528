"""The shape of a head, facing +z, with its neck's end at y = 0: of a sample of its own, and on the body."""

import numpy as np

from _shapes import Floats, capsule, cut, ellipsoid, norm, on_one_side, smoothstep, union

BROW_HEIGHT = 0.232  # metres, of the brow ridge at rest


def head_field(points: Floats, *, growth: float = 1.0, brows: float = 0.0) -> Floats:
    """Signed distance to head and neck.

    Args:
        points: (n, 3), metres.
        growth: 0 with nose and ears inside the head, 1 with both in their places.
        brows: Metres by which the brow ridge is raised.
    """
    points = on_one_side(points)
    x, y, z = points.T
    shape = ellipsoid(points, [0.0, 0.246, -0.014], [0.0765, 0.088, 0.097])
    shape = union(shape, ellipsoid(points, [0.0, 0.182, 0.024], [0.061, 0.080, 0.063]), 0.03)
    shape = union(shape, capsule(points, [0.050, 0.160, -0.005], [0.017, 0.119, 0.066], 0.012, 0.014), 0.03)
    shape = union(shape, ellipsoid(points, [0.0, 0.118, 0.076], [0.020, 0.015, 0.013]), 0.018)
    shape = union(shape, ellipsoid(points, [0.041, 0.184, 0.053], [0.021, 0.018, 0.019]), 0.02)
    shape = union(shape, ellipsoid(points, [0.030, 0.152, 0.056], [0.024, 0.026, 0.019]), 0.02)
    neck = (np.sqrt((x / 0.059) ** 2 + ((z + 0.030 - 0.10 * y) / 0.062) ** 2) - 1.0) * 0.059
    neck = neck + 0.020 * smoothstep(0.0, 0.07, y) - 0.014
    neck = -union(-neck, 0.19 - y, 0.03)
    shape = union(shape, neck, 0.025)
    h, z_ridge = BROW_HEIGHT + brows, 0.0795 - 0.2 * brows
    ridge = capsule(points, [0.0, h - 0.002, z_ridge], [0.030, h + 0.002, z_ridge - 0.0070], 0.0075, 0.0075)
    ridge = union(
        ridge,
        capsule(points, [0.030, h + 0.002, z_ridge - 0.0070], [0.054, h - 0.010, z_ridge - 0.0320], 0.0075, 0.0060),
        0.008,
    )
    shape = union(shape, ridge, 0.018)
    shape = cut(shape, ellipsoid(points, [0.032, 0.212, 0.094], [0.019, 0.0130, 0.018]), 0.016)
    eye = ellipsoid(points, [0.0315, 0.2115, 0.0655], [0.0140, 0.0125, 0.0135])
    lid = ellipsoid(points, [0.0315, 0.2125, 0.0655], [0.0155, 0.0140, 0.0150])
    shape = union(shape, union(eye, cut(lid, y - 0.2125 - 0.12 * (x - 0.0315), 0.002), 0.002), 0.005)
    nose = points + np.array([0.0, 0.0, 0.030 * (1.0 - growth)])
    shape = union(shape, capsule(nose, [0.0, 0.219, 0.080], [0.0, 0.184, 0.1015], 0.0080, 0.0080), 0.014)
    shape = union(shape, ellipsoid(nose, [0.0, 0.1800, 0.1020], [0.0105, 0.0095, 0.0110]), 0.008)
    shape = union(shape, ellipsoid(nose, [0.0110, 0.1770, 0.0910], [0.0080, 0.0080, 0.0110]), 0.009)
    shape = union(shape, capsule(nose, [0.0, 0.176, 0.098], [0.0, 0.166, 0.084], 0.0050, 0.0050), 0.010)
    shape = union(shape, ellipsoid(points, [0.0, 0.1480, 0.072], [0.032, 0.024, 0.0165]), 0.020)
    upper = capsule(points, [0.004, 0.1545, 0.0855], [0.024, 0.1490, 0.0690], 0.0062, 0.0050)
    lower = capsule(points, [0.004, 0.1420, 0.0825], [0.020, 0.1470, 0.0690], 0.0070, 0.0050)
    shape = union(union(shape, upper, 0.010), lower, 0.012)
    shape = cut(shape, capsule(points, [0.004, 0.1486, 0.0948], [0.021, 0.1482, 0.0865], 0.0032, 0.0026), 0.010)
    side = points + np.array([0.025 * (1.0 - growth), 0.0, 0.0])
    ear = ellipsoid(side, [0.0765, 0.205, -0.016], [0.0095, 0.030, 0.018])
    ear = cut(ear, ellipsoid(side, [0.088, 0.208, -0.012], [0.0085, 0.018, 0.010]), 0.008)
    return union(shape, ear, 0.016)


def face_density(points: Floats) -> Floats:
    """Density of the head's vertices: eyes, nose and mouth need more."""
    points = on_one_side(points)
    face = smoothstep(0.085, 0.03, norm((points - [0.0, 0.19, 0.09]) * [1.0, 0.8, 0.8]))
    nose = smoothstep(0.040, 0.010, norm(points - [0.0, 0.180, 0.106]))
    ear = smoothstep(0.040, 0.010, norm(points - [0.083, 0.205, -0.016]))
    mouth = smoothstep(0.040, 0.015, norm(points - [0.0, 0.148, 0.090]))
    eye = smoothstep(0.030, 0.010, norm(points - [0.0315, 0.212, 0.078]))
    return 1.0 + 1.2 * face + 1.5 * nose + 3.0 * ear + 2.5 * mouth + 1.5 * eye
