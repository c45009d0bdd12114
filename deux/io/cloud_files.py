"""Coloured point clouds as binary PLY and GLB files, by trimesh."""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import trimesh

from deux.geometry.point_cloud import PointCloud
from deux.io.atomic import make_folder, write_atomically

CloudFormat = Literal["ply", "glb"]
"""The formats of clouds: PLY for MeshLab, CloudCompare and Open3D; GLB (binary glTF) for viewers in browsers."""

CLOUD_FORMATS: tuple[CloudFormat, ...] = get_args(CloudFormat)

CAMERA_TO_GLTF = np.diag([1.0, -1.0, -1.0, 1.0])
"""Turns OpenCV's camera axes, y down, so that a viewer which takes y for up shows the picture upright."""


def write_cloud(path: Path, cloud: PointCloud, camera_axes: bool = False) -> None:
    """Write a cloud, whole or not at all; the suffix tells the format.

    Args:
        path: a .ply or .glb file.
        cloud: at least one point.
        camera_axes: whether the points are in a camera's axes and not in a world's. Viewers of GLB files take y for up,
            so these files then turn the points; PLY files hold them as they are.

    Raises:
        DeuxError: the file cannot be written.
    """
    points = trimesh.PointCloud(cloud.points, colors=cloud.colors)
    if path.suffix == ".ply":
        content = points.export(file_type="ply")
    else:
        scene = trimesh.Scene()
        scene.add_geometry(points, transform=CAMERA_TO_GLTF if camera_axes else np.eye(4))
        content = scene.export(file_type="glb")
    make_folder(path.parent)
    write_atomically(path, content)
