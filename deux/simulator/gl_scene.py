"""A mesh in the memory of OpenGL: corners, textures, and the draw calls of its clusters of triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deux.contracts import SceneMesh
from deux.errors import DeuxError
from deux.geometry.texture_pyramids import TexturePyramids
from deux.simulator.gl_clusters import Clusters, make_clusters
from deux.simulator.gl_context import GLContext
from deux.simulator.gl_shaders import shaders
from deux.simulator.gl_target import RenderTarget
from deux.simulator.textures import pack_textures

if TYPE_CHECKING:
    import moderngl

_SIDE = 4096  # texels of a row, and rows of a layer, of the texture that holds all others; the shader knows it too
_CORNER = np.dtype([("position", "3f4"), ("uv", "2f4"), ("tint", "4u1"), ("texture", "2i4"), ("vertex_color", "4u1")])
_BLOCK = 256  # rows that are converted at once; layers are a multiple of it
_WHITE = np.full((1, 1, 3), 255, np.uint8)  # the texture of materials that have none


class GLScene:
    """One mesh in an OpenGL context, made once for all cameras.

    Args:
        mesh: what is drawn.

    Raises:
        DeuxError: there is no OpenGL, or its memory is too small for the textures.
    """

    def __init__(self, mesh: SceneMesh) -> None:
        self.context = GLContext()
        self.clusters = make_clusters(mesh)
        self._vertex_colors = mesh.vertex_colors is not None
        self._programs: dict[tuple[bool, bool], tuple[Any, moderngl.VertexArray]] = {}
        pyramids = mesh.pyramids or pack_textures(mesh.materials)
        corners, indices = _corners(mesh, self.clusters, pyramids)
        with self.context as gl:
            self._corners, self._indices = gl.buffer(corners.tobytes()), gl.buffer(indices.tobytes())
            self._first_face = gl.buffer(self.clusters.first.astype(np.int32).tobytes())
            self._texels, self._level_start = _upload_texels(gl, pyramids), _upload_level_starts(gl, pyramids)

    def draw(
        self,
        targets: Sequence[RenderTarget],
        clip_from_world: Sequence[np.ndarray],
        clusters: Sequence[np.ndarray],
        new: bool = True,
    ) -> None:
        """Draw into each target; inside the context.

        Args:
            targets: what is drawn into; all of one kind, and at least as many as images.
            clip_from_world: the 4 x 4 matrix of each image.
            clusters: the numbers of the clusters that each image shows, in the order in which they are drawn.
            new: whether new images begin; otherwise this is drawn beside what is there.
        """
        program, mesh = self._program(targets[0].colors, targets[0].faces)
        commands = self.context.gl.buffer(self._commands(np.concatenate(clusters)).tobytes() or bytes(1))
        first = 0
        for target, matrix, numbers in zip(targets, clip_from_world, clusters, strict=False):
            target.begin(new)
            if len(numbers):
                program["clip_from_world"].write(matrix.T.astype(np.float32).tobytes())
                mesh.render_indirect(commands, count=len(numbers), first=first)
            first += len(numbers)

    def _commands(self, clusters: np.ndarray) -> np.ndarray:
        """What `glMultiDrawElementsIndirect` reads to draw these clusters in this order, N x 5 uint32."""
        commands = np.zeros((len(clusters), 5), np.uint32)
        commands[:, 0] = 3 * self.clusters.size[clusters]
        commands[:, 1] = 1
        commands[:, 2] = 3 * self.clusters.first[clusters]
        commands[:, 4] = clusters  # the instance, from which the shader knows the cluster's first face
        return commands

    def _program(self, colors: bool, faces: bool) -> tuple[Any, moderngl.VertexArray]:
        """The program that draws depth and what is asked for, and the mesh as its input."""
        if (colors, faces) not in self._programs:
            self._programs[colors, faces] = self._make_program(colors, faces)
        self._texels.use(0)
        self._level_start.use(1)
        return self._programs[colors, faces]

    def _make_program(self, colors: bool, faces: bool) -> tuple[Any, moderngl.VertexArray]:
        gl = self.context.gl
        vertex_shader, fragment_shader = shaders(colors, faces, self._vertex_colors)
        program = gl.program(vertex_shader=vertex_shader, fragment_shader=fragment_shader)
        names, layout = ["position"], "3f4 24x1"
        if colors:
            names, layout = ["position", "uv", "tint", "texture_"], "3f4 2f4 4f1 2i4 4x1"
            program["texels"], program["level_start"] = 0, 1
            if self._vertex_colors:
                names, layout = [*names, "vertex_color"], "3f4 2f4 4f1 2i4 4f1"
        content: list[tuple[Any, ...]] = [(self._corners, layout, *names)]
        if faces:
            content.append((self._first_face, "1i4/i", "first_face"))
        return program, gl.vertex_array(program, content, index_buffer=self._indices)


def _corners(mesh: SceneMesh, clusters: Clusters, pyramids: TexturePyramids) -> tuple[np.ndarray, np.ndarray]:
    """The mesh's distinct corners in the order in which they are first drawn, and the corners of each face.

    Corners at a vertex that look like the one that comes last there share an entry with it; any other has its own.
    """
    vertex = mesh.faces[clusters.order].reshape(-1)
    material = np.repeat(mesh.face_material[clusters.order], 3)
    corners = np.zeros(len(vertex), _CORNER)
    corners["position"] = mesh.vertices[vertex]
    # A lookup at a coordinate that is not a number would read outside the texture.
    corners["uv"] = np.nan_to_num(mesh.uv[clusters.order], posinf=0.0, neginf=0.0).reshape(-1, 2)
    corners["tint"][:, :3] = np.array([m.color for m in mesh.materials], np.uint8).reshape(-1, 3)[material]
    corners["texture"] = _texture_of_material(pyramids)[material]
    if mesh.vertex_colors is not None:
        corners["vertex_color"][:, :3] = mesh.vertex_colors[vertex]

    entry = np.arange(len(vertex))
    last = np.zeros(len(mesh.vertices), np.int64)
    last[vertex] = entry
    shared = last[vertex]
    bits = corners.view(np.int32).reshape(len(corners), -1)
    entry = np.where((bits == bits[shared]).all(axis=1), shared, entry)
    kept, first_use, number = np.unique(entry, return_index=True, return_inverse=True)
    drawn = np.argsort(first_use)
    place = np.empty_like(drawn)
    place[drawn] = np.arange(len(drawn))
    return corners[kept[drawn]], place[number].astype(np.uint32)


def _texture_of_material(pyramids: TexturePyramids) -> np.ndarray:
    """The number of each material's texture, and its width | height << 16; M x 2 int32."""
    sizes = np.concatenate([pyramids.sizes, [_WHITE.shape[:2]]])
    number = np.asarray(pyramids.material_texture)
    return np.stack([np.where(number < 0, len(pyramids.sizes), number), sizes[number, 1] | sizes[number, 0] << 16], 1)


def _upload_level_starts(gl: moderngl.Context, pyramids: TexturePyramids) -> moderngl.Texture:
    """A table of where each level of each texture begins, in texels; its last row is the white one."""
    starts = np.pad(np.asarray(pyramids.offsets) // 3, ((0, 1), (0, 1)), constant_values=-1)
    starts[-1] = len(pyramids.texels) // 3
    # The level beyond the last one is read with weight 0.
    starts = np.maximum.accumulate(starts, axis=1).astype(np.int32)
    table = gl.texture(starts.shape[::-1], 1, starts.tobytes(), dtype="i4")
    table.filter = gl.NEAREST, gl.NEAREST
    return table


def _upload_texels(gl: moderngl.Context, pyramids: TexturePyramids) -> moderngl.TextureArray:
    """All pyramids one after the other, row by row and layer by layer, as RGBA; at the end the white texture."""
    texels = pyramids.texels.reshape(-1, 3)
    rows = -(-(len(texels) + 1) // _SIDE)
    height = min(rows, _SIDE)
    size = _SIDE, height, -(-rows // height)
    try:
        texture = gl.texture_array(size, 4)
    except Exception as cause:  # moderngl raises plain exceptions
        raise DeuxError(
            f"simulator.renderer=gl has no room for {len(texels):,} texels ({cause}): set simulator.renderer=embree."
        ) from cause
    texture.filter = gl.NEAREST, gl.NEAREST
    # One texel beyond the last is the white texture.
    for row in range(0, rows, _BLOCK):
        count = min(_BLOCK, rows - row)
        part = texels[row * _SIDE : (row + count) * _SIDE]
        block = np.full((count * _SIDE, 4), 255, np.uint8)
        block[: len(part), :3] = part
        texture.write(block.tobytes(), viewport=(0, row % _SIDE, row // _SIDE, _SIDE, count, 1))
    return texture
