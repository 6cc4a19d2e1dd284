"""Solid rotations of the sphere, and the forms that its profiles solve."""

import numpy as np

FORMS = {
    "cubic_spline": "transport",
    "quintic_spline": "transport",
    "csl2_spline": "advection",
    "csl4_spline": "advection",
}


def rotation(angle, speed=2 * np.pi):
    """Solid rotation about an axis that leans by an angle (Williamson et al. 1992, test 1)."""

    def wind(lon, lat):
        u = np.cos(lat) * np.cos(angle) + np.sin(lat) * np.cos(lon) * np.sin(angle)
        return speed * u, -speed * np.sin(lon) * np.sin(angle)

    return wind


def turned(lon, lat, angle, by):
    """Where the same rotation carried points from, by Rodrigues' formula."""
    lon, lat = np.broadcast_arrays(lon, lat)
    x = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    axis = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    turn = np.tensordot(np.cross(np.eye(3), axis), x, 1)  # axis x point
    along = np.multiply.outer(axis, np.tensordot(axis, x, 1))
    x = x * np.cos(by) - turn * np.sin(by) + along * (1.0 - np.cos(by))
    return np.arctan2(x[1], x[0]), np.arctan2(x[2], np.hypot(x[0], x[1]))
