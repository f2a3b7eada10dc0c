"""Rendering of only those rows of a frame that somebody looks at; they are the same to the bit as in a whole frame.

Another viewport would round differently. Instead, surfaces right in front of the camera cover the other rows, so that
nothing behind them is textured, and meshes that are only in those rows are not drawn.
"""

from panda3d.core import (
    BitMask32,
    BoundingHexahedron,
    Camera,
    CullBinManager,
    Geom,
    GeomNode,
    GeomTriangles,
    GeomVertexData,
    GeomVertexFormat,
    GeomVertexWriter,
    LPoint3,
    NodePath,
    OmniBoundingVolume,
)

from pilot.vehicle import COLUMNS, FOCAL_LENGTH, ROWS, WHOLE_FRAME, Rows

SLACK = 1.0  # rows beside the visible ones that are not covered, against rounding
BEHIND_NEAR_PLANE = 1.02  # distance of the covering surfaces, as a multiple of the nearest visible one
BIN = "row mask"


class RowMask:
    """Covers rows of a camera's frame."""

    def __init__(self, camera: NodePath, number: int) -> None:
        """Create a mask that covers nothing.

        Args:
            camera: node of a `Camera` that looks along its y axis.
            number: of the camera, by which the masks of several cameras in a scene are told apart.
        """
        CullBinManager.get_global_ptr().add_bin(BIN, CullBinManager.BT_fixed, 5)  # before the background
        self._node, self._camera = camera, camera.node()
        self._camera.set_camera_mask(BitMask32.bit(number))
        self._covers = camera.attach_new_node("row mask")
        self._covers.hide(~BitMask32.bit(number))  # from the other cameras
        self._covers.set_bin(BIN, 0)
        self._covers.set_color(0, 0, 0, 1)
        self._rows = WHOLE_FRAME

    def uncover(self, rows: Rows) -> None:
        """Cover all rows but the range `rows`."""
        if rows == self._rows:
            return
        self._rows = rows
        self._covers.node().remove_all_children()
        nearest = self._camera.get_lens().get_near() * BEHIND_NEAR_PLANE
        for first, last in ((-SLACK, rows[0] - SLACK), (rows[1] + SLACK, ROWS + SLACK)):
            if last > 0 and first < ROWS:
                self._covers.attach_new_node(_cover(first, last, nearest))
        self._camera.set_cull_bounds(_view(rows[0] - SLACK, rows[1] + SLACK, self._camera))


def _point(column: float, row: float, distance: float) -> LPoint3:
    """Return the point at a distance ahead of the camera (metres) that is seen at a column and row."""
    return LPoint3((column - COLUMNS / 2) / FOCAL_LENGTH, 1, (ROWS / 2 - row) / FOCAL_LENGTH) * distance


def _view(first: float, last: float, camera: Camera) -> BoundingHexahedron:
    """Return the volume that is seen in rows first..last."""
    outline = ((0, last), (COLUMNS, last), (COLUMNS, first), (0, first))
    lens = camera.get_lens()
    return BoundingHexahedron(
        *(_point(*corner, distance) for distance in (lens.get_far(), lens.get_near()) for corner in outline)
    )


def _cover(first: float, last: float, distance: float) -> GeomNode:
    """Return a surface that is seen in rows first..last."""
    vertices = GeomVertexData("row mask", GeomVertexFormat.get_v3(), Geom.UH_static)
    writer = GeomVertexWriter(vertices, "vertex")
    for corner in ((0, first), (0, last), (COLUMNS, last), (COLUMNS, first)):
        writer.add_data3(_point(*corner, distance))
    triangles = GeomTriangles(Geom.UH_static)
    triangles.add_vertices(0, 1, 2)
    triangles.add_vertices(0, 2, 3)
    geom = Geom(vertices)
    geom.add_primitive(triangles)
    node = GeomNode("row mask")
    node.add_geom(geom)
    node.set_bounds(OmniBoundingVolume())  # the view, from which it would be culled, excludes it
    node.set_final(True)
    return node
