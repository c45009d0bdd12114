"""Unlit shading of ray hits: texture x base colour x vertex colour."""

import math
from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.contracts import SceneMesh
from deux.geometry.texture_pyramids import TexturePyramids
from deux.simulator.textures import pack_textures, trilinear_lookup

_BLOCK = 100_000  # triangles that are processed at once in float64, to limit memory


class Surfaces(NamedTuple):
    """The inputs of shading for F triangles and M materials.

    Args:
        uv: F x 3 x 2 float32, texture coordinates of the corners.
        normal: F x 3 float32, unit normals.
        uv_gradient: F x 2 x 3 float32, gradients of u and v per metre in the triangle's plane.
        material: F int32.
        corner_color: F x 3 x 3 uint8, colours of the corners; 0 x 3 x 3 if the mesh has none.
        base_color: M x 3 float32, 0 to 255.
        textures: the materials' textures.
    """

    uv: np.ndarray
    normal: np.ndarray
    uv_gradient: np.ndarray
    material: np.ndarray
    corner_color: np.ndarray
    base_color: np.ndarray
    textures: TexturePyramids


def prepare_surfaces(mesh: SceneMesh) -> Surfaces:
    """Compute the inputs of shading from a mesh."""
    # A lookup at NaN would read outside of the texture.
    uv = np.nan_to_num(mesh.uv, posinf=0.0, neginf=0.0)
    normal = np.empty((len(mesh.faces), 3), np.float32)
    gradient = np.empty((len(mesh.faces), 2, 3), np.float32)
    for start in range(0, len(mesh.faces), _BLOCK):
        block = np.s_[start : start + _BLOCK]
        normal[block], gradient[block] = _normal_and_gradient(mesh.vertices[mesh.faces[block]], uv[block])
    colors = mesh.vertex_colors
    return Surfaces(
        uv=uv,
        normal=normal,
        uv_gradient=gradient,
        material=np.ascontiguousarray(mesh.face_material, dtype=np.int32),
        corner_color=np.zeros((0, 3, 3), np.uint8) if colors is None else colors[mesh.faces],
        base_color=np.array([material.color for material in mesh.materials], np.float32).reshape(-1, 3),
        textures=mesh.pyramids or pack_textures(mesh.materials),
    )


def _normal_and_gradient(corners: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals of triangles (F x 3), and gradients of u and v per metre in their planes (F x 2 x 3), float64."""
    corners, uv = corners.astype(np.float64), uv.astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    # The bound keeps the gradient of triangles without area finite; no ray hits them.
    squared = np.maximum((normal**2).sum(axis=1, keepdims=True), 1e-30)
    # The dual basis of the two edges transforms a step in the plane to a step in barycentric coordinates.
    dual = np.stack([np.cross(second, normal), np.cross(normal, first)], axis=1) / squared[..., None]
    gradient = np.einsum("fec,fex->fcx", uv[:, 1:] - uv[:, :1], dual)
    return normal / np.sqrt(squared), gradient


@compiled(nogil=True, error_model="numpy")
def mip_level(
    ray: np.ndarray,
    right: np.ndarray,
    down: np.ndarray,
    depth: float,
    normal: np.ndarray,
    gradient: np.ndarray,
    height: int,
    width: int,
) -> float:
    """The mip level at a hit as OpenGL defines it: the binary logarithm of a pixel's footprint in texels.

    When the ray moves by one pixel, the hit point P = depth x ray stays in the triangle's plane, so
    dP/dx = depth (right - ray (normal . right) / (normal . ray)); the texture coordinates change by gradient . dP/dx.
    The footprint is the longer of the steps along x and along y.

    Args:
        ray: 3, the pixel's direction in the world, with a depth of 1.
        right: 3, the difference of `ray` to the next pixel on the right.
        down: 3, the difference of `ray` to the next pixel below.
        depth: depth of the hit in metres.
        normal: 3, the triangle's normal.
        gradient: 2 x 3, gradients of u and v per metre.
        height: height of the texture in texels.
        width: width of the texture in texels.
    """
    facing = normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]
    if abs(facing) < 1e-6:
        facing = 1e-6
    u_ray = gradient[0, 0] * ray[0] + gradient[0, 1] * ray[1] + gradient[0, 2] * ray[2]
    v_ray = gradient[1, 0] * ray[0] + gradient[1, 1] * ray[1] + gradient[1, 2] * ray[2]
    longest = 1e-12  # squared; above 0 for the logarithm
    for step in (right, down):
        slope = (normal[0] * step[0] + normal[1] * step[1] + normal[2] * step[2]) / facing
        du = gradient[0, 0] * step[0] + gradient[0, 1] * step[1] + gradient[0, 2] * step[2] - slope * u_ray
        dv = gradient[1, 0] * step[0] + gradient[1, 1] * step[1] + gradient[1, 2] * step[2] - slope * v_ray
        longest = max(longest, (depth * du * width) ** 2 + (depth * dv * height) ** 2)
    return 0.5 * math.log2(longest)


@compiled(nogil=True, error_model="numpy")
def shade(
    face: np.ndarray,
    barycentric: np.ndarray,
    depth: np.ndarray,
    rays: np.ndarray,
    right: np.ndarray,
    down: np.ndarray,
    surfaces: Surfaces,
) -> np.ndarray:
    """Compute the colours of N hits, N x 3 uint8; black if `face` is -1.

    Args:
        face: N int32, the triangle hit.
        barycentric: N x 2 float32, weights of the triangle's second and third corner.
        depth: N float32, metres.
        rays: N x 3 float32, directions in the world, with a depth of 1.
        right: 3 float32, the difference of a ray to the next pixel on the right.
        down: 3 float32, the difference of a ray to the next pixel below.
        surfaces: the surfaces of the scene.
    """
    textures = surfaces.textures
    colors = np.zeros((face.size, 3), dtype=np.uint8)
    for i in range(face.size):
        f = face[i]
        if f < 0:
            continue
        b, c = barycentric[i, 0], barycentric[i, 1]
        a = 1.0 - b - c
        material = surfaces.material[f]
        base = surfaces.base_color[material]
        red, green, blue = float(base[0]), float(base[1]), float(base[2])
        texture = textures.material_texture[material]
        if texture >= 0:
            uv = surfaces.uv[f]
            s = a * uv[0, 0] + b * uv[1, 0] + c * uv[2, 0]
            t = a * uv[0, 1] + b * uv[1, 1] + c * uv[2, 1]
            height, width = textures.sizes[texture, 0], textures.sizes[texture, 1]
            level = mip_level(
                rays[i], right, down, depth[i], surfaces.normal[f], surfaces.uv_gradient[f], height, width
            )
            texel = trilinear_lookup(textures.texels, textures.offsets[texture], height, width, s, t, level)
            red, green, blue = red * texel[0] / 255.0, green * texel[1] / 255.0, blue * texel[2] / 255.0
        if surfaces.corner_color.shape[0] > 0:
            corner = surfaces.corner_color[f]
            red *= (a * corner[0, 0] + b * corner[1, 0] + c * corner[2, 0]) / 255.0
            green *= (a * corner[0, 1] + b * corner[1, 1] + c * corner[2, 1]) / 255.0
            blue *= (a * corner[0, 2] + b * corner[1, 2] + c * corner[2, 2]) / 255.0
        colors[i, 0] = int(red + 0.5)
        colors[i, 1] = int(green + 0.5)
        colors[i, 2] = int(blue + 0.5)
    return colors
