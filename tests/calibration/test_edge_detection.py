"""Edge detection in drawn images with known edges."""

import numpy as np

from omnimirror.calibration.edge_detection import MAX_EDGES, at_working_size, edges_of


def test_strong_pattern_does_not_suppress_faint_circle():
    """Black and white squares of 8 px have more edges than the limit, all of them steeper than
    those of the disc."""
    v, u = np.mgrid[:360, :640]
    away = np.hypot(u - 330.0, v - 180.0)
    squares = 255.0 * ((u // 8 + v // 8) % 2)
    moat = np.clip(away - 165.0, 0.0, 1.0)  # grey surround that isolates the edge of the disc
    image = squares * moat + 60.0 * (1 - moat)
    image = np.where(away < 150, 160.0, image).astype(np.uint8)
    edges = edges_of(at_working_size(image))
    assert len(edges.points) >= MAX_EDGES
    on_rim = np.abs(np.hypot(edges.points[:, 0] - 330.0, edges.points[:, 1] - 180.0) - 150) < 1.5
    turn = (
        np.degrees(np.arctan2(edges.points[on_rim, 1] - 180.0, edges.points[on_rim, 0] - 330.0))
        % 360
    )
    assert len(np.unique(turn // 5)) > 65  # of 72 directions
