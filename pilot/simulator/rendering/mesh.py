"""Meshes of quads as arrays, the form in which terrain, road and plants are passed to the renderer."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats

CHUNK = 64.0  # metres, side of the squares that are drawn or culled as a whole


@dataclass(frozen=True, eq=False)
class Mesh:
    """Quads with one texture.

    Attributes:
        texture: name of a surface or plant.
        corners: n x 4 x 3, metres, counter-clockwise as seen from the visible side.
        colours: n x 4 x 3, RGB, 0..255; multiplied by the texture.
        texels: texture coordinates, n x 4 x 2, in tiles.
    """

    texture: str
    corners: Floats
    colours: Floats
    texels: Floats

    def chunks(self) -> list["Mesh"]:
        """Split the mesh by squares of 64 m x 64 m, so that those out of view are not drawn."""
        squares = np.floor(self.corners[:, :, :2].mean(1) / CHUNK).astype(int)
        names, piece = np.unique(squares, axis=0, return_inverse=True)
        return [self.subset(np.flatnonzero(piece.ravel() == number)) for number in range(len(names))]

    def multiplied(self, light: Floats) -> "Mesh":
        """Return the mesh with its colours multiplied by the light at its corners (n x 4 x 3, RGB, 0..1)."""
        return Mesh(self.texture, self.corners, self.colours * light, self.texels)

    def subset(self, quads: NDArray[np.intp]) -> "Mesh":
        """Return a mesh of the quads with the given indices."""
        return Mesh(self.texture, self.corners[quads], self.colours[quads], self.texels[quads])


def join(meshes: Iterable[Mesh]) -> list[Mesh]:
    """Merge meshes with the same texture; the result is in the order of each texture's first mesh."""
    alike: dict[str, list[Mesh]] = {}
    for mesh in meshes:
        alike.setdefault(mesh.texture, []).append(mesh)
    return [
        Mesh(
            texture,
            *(np.concatenate([getattr(mesh, name) for mesh in group]) for name in ("corners", "colours", "texels")),
        )
        for texture, group in alike.items()
    ]
