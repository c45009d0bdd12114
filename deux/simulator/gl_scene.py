"""A mesh as OpenGL buffers and textures, and the draw calls of its clusters of triangles."""

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

_SIDE = 4096  # texels of a row, and rows of a layer, of the texture that contains all textures; as in the shader
_CORNER = np.dtype([("position", "3f4"), ("uv", "2f4"), ("tint", "4u1"), ("texture", "2i4"), ("vertex_color", "4u1")])
_BLOCK = 256  # rows that are converted at once; divides the rows of a layer
_WHITE = np.full((1, 1, 3), 255, np.uint8)  # the texture of materials without a texture


class GLScene:
    """A mesh in an OpenGL context, shared by all cameras.

    Args:
        mesh: the scene's mesh.

    Raises:
        DeuxError: OpenGL is not available, or its memory is too small for the textures.
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
        """Render N images; the context must be current.

        Args:
            targets: at least N render targets, all with the same attachments.
            clip_from_world: N 4 x 4 matrices.
            clusters: indices of the clusters of each image, in the order of drawing.
            new: whether to clear the targets first.
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
        """The commands of `glMultiDrawElementsIndirect` that draw N clusters in this order, N x 5 uint32."""
        commands = np.zeros((len(clusters), 5), np.uint32)
        commands[:, 0] = 3 * self.clusters.size[clusters]
        commands[:, 1] = 1
        commands[:, 2] = 3 * self.clusters.first[clusters]
        commands[:, 4] = clusters  # the instance, which selects the cluster's first face
        return commands

    def _program(self, colors: bool, faces: bool) -> tuple[Any, moderngl.VertexArray]:
        """The program that renders depth, and optionally colours and faces, with its vertex array."""
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
    """The vertex buffer with duplicate corners removed, in the order of first use, and the index buffer.

    Of the corners at a vertex only those equal to the last one are merged, which is sufficient and fast.
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
    entries, first_use, number = np.unique(entry, return_index=True, return_inverse=True)
    drawn = np.argsort(first_use)
    place = np.empty_like(drawn)
    place[drawn] = np.arange(len(drawn))
    return corners[entries[drawn]], place[number].astype(np.uint32)


def _texture_of_material(pyramids: TexturePyramids) -> np.ndarray:
    """The index of each material's texture, and its width | height << 16; M x 2 int32."""
    sizes = np.concatenate([pyramids.sizes, [_WHITE.shape[:2]]])
    number = np.asarray(pyramids.material_texture)
    return np.stack([np.where(number < 0, len(pyramids.sizes), number), sizes[number, 1] | sizes[number, 0] << 16], 1)


def _upload_level_starts(gl: moderngl.Context, pyramids: TexturePyramids) -> moderngl.Texture:
    """Upload the first texel of each level of each texture; the last row is the white texture."""
    starts = np.pad(np.asarray(pyramids.offsets) // 3, ((0, 1), (0, 1)), constant_values=-1)
    starts[-1] = len(pyramids.texels) // 3
    # The shader reads the level beyond the last one with weight 0.
    starts = np.maximum.accumulate(starts, axis=1).astype(np.int32)
    table = gl.texture(starts.shape[::-1], 1, starts.tobytes(), dtype="i4")
    table.filter = gl.NEAREST, gl.NEAREST
    return table


def _upload_texels(gl: moderngl.Context, pyramids: TexturePyramids) -> moderngl.TextureArray:
    """Upload the texels of all pyramids as RGBA, row by row and layer by layer, with the white texture at the end."""
    texels = pyramids.texels.reshape(-1, 3)
    rows = -(-(len(texels) + 1) // _SIDE)
    height = min(rows, _SIDE)
    size = _SIDE, height, -(-rows // height)
    try:
        texture = gl.texture_array(size, 4)
    except Exception as cause:  # moderngl raises plain exceptions
        raise DeuxError(
            f"simulator.renderer=gl cannot store {len(texels):,} texels ({cause}): set simulator.renderer=embree."
        ) from cause
    texture.filter = gl.NEAREST, gl.NEAREST
    # The texel after the last one is the white texture.
    for row in range(0, rows, _BLOCK):
        count = min(_BLOCK, rows - row)
        part = texels[row * _SIDE : (row + count) * _SIDE]
        block = np.full((count * _SIDE, 4), 255, np.uint8)
        block[: len(part), :3] = part
        texture.write(block.tobytes(), viewport=(0, row % _SIDE, row // _SIDE, _SIDE, count, 1))
    return texture
