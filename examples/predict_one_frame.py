"""Complete the depth of one frame: python examples/predict_one_frame.py MODEL IMAGE SPARSE K.txt

MODEL is a run folder or a model file, SPARSE a 16-bit PNG file of metres x 256 (or .npy of metres; 0 = none), and K.txt
the 3 x 3 camera matrix in pixels of the image. Writes depth.npy, in metres, and depth.png to look at.
"""

import sys
from pathlib import Path

import numpy as np

import deux
from deux.figures.depth_figures import draw_depth
from deux.figures.drawing import save_figure
from deux.io.camera_files import read_any_depth, read_any_image, read_any_intrinsics


def main(model: str, image: str, sparse: str, intrinsics: str) -> None:
    """Predict, and write the files into the working folder."""
    depth = deux.predict(
        read_any_image(Path(image)),  # H x W x 3 uint8
        read_any_depth(Path(sparse)),  # H x W metres
        read_any_intrinsics(Path(intrinsics)),  # 3 x 3
        model=deux.load(model),
    )
    np.save("depth.npy", depth)
    save_figure(draw_depth(depth), Path("depth.png"))
    print(f"{depth.shape[1]} x {depth.shape[0]} pixels, {depth.min():.2f} to {depth.max():.2f} m: depth.npy, depth.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
