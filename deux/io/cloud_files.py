"""Writing of coloured point clouds as binary PLY and GLB files with trimesh."""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import trimesh

from deux.geometry.point_cloud import PointCloud
from deux.io.atomic import make_folder, write_atomically

CloudFormat = Literal["ply", "glb"]
"""The formats of point clouds: PLY for MeshLab, CloudCompare and Open3D; GLB (binary glTF) for browsers."""

CLOUD_FORMATS: tuple[CloudFormat, ...] = get_args(CloudFormat)

CAMERA_TO_GLTF = np.diag([1.0, -1.0, -1.0, 1.0])
"""Rotation from OpenCV's camera axes (y down) to those of glTF viewers (y up)."""


def write_cloud(path: Path, cloud: PointCloud, camera_axes: bool = False) -> None:
    """Write a point cloud atomically, in the format of the suffix.

    Args:
        path: a .ply or .glb file.
        cloud: a cloud of at least one point.
        camera_axes: whether the points are in camera axes instead of world axes. GLB files then rotate the points,
            because viewers expect y to point up; PLY files contain them as they are.

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
