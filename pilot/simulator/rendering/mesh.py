"""Quads as arrays: the form in which land, road and trees go to the renderer."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilot.arrays import Floats

CHUNK = 64.0  # metres, what is drawn or left out as a whole


@dataclass(frozen=True, eq=False)
class Mesh:
    """Quads with one texture.

    Attributes:
        texture: name of a surface or plant.
        corners: n x 4 x 3, metres, counter-clockwise as seen from where it is visible.
        colours: n x 4 x 3, RGB 0..255, which the texture is multiplied with.
        texels: n x 4 x 2, texture coordinates, in tiles.
    """

    texture: str
    corners: Floats
    colours: Floats
    texels: Floats

    def chunks(self) -> list["Mesh"]:
        """The mesh in pieces of at most 64 m x 64 m, so that what is out of sight need not be drawn."""
        squares = np.floor(self.corners[:, :, :2].mean(1) / CHUNK).astype(int)
        names, piece = np.unique(squares, axis=0, return_inverse=True)
        return [self.subset(np.flatnonzero(piece.ravel() == number)) for number in range(len(names))]

    def subset(self, quads: NDArray[np.intp]) -> "Mesh":
        """Some of the quads."""
        return Mesh(self.texture, self.corners[quads], self.colours[quads], self.texels[quads])


def join(meshes: Iterable[Mesh]) -> list[Mesh]:
    """One mesh for each texture, in the order of their first."""
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
