"""Bodies on a line by shapely alone: what the map's own sweeps are checked against; no test in here."""

from __future__ import annotations

from shapely import affinity
from shapely.geometry import LineString, Polygon, box


def body(line: LineString, front_m: float, length_m: float, width_m: float) -> Polygon:
    """A grown body from the front bumper back along its chord of `line`, at its full length."""
    front, rear = line.interpolate(front_m), line.interpolate(front_m - length_m)
    chord = front.distance(rear)
    flat = box(-length_m - 0.3, -width_m / 2 - 0.3, 0.3, width_m / 2 + 0.3)
    x, y = front.x - rear.x, front.y - rear.y
    turned = affinity.affine_transform(flat, [x / chord, -y / chord, y / chord, x / chord, front.x, front.y])
    assert isinstance(turned, Polygon)
    return turned
