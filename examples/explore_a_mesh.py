"""Explore a mesh, or else a generated flat, and watch it: python examples/explore_a_mesh.py house.glb [STEPS]"""

import sys

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter

from deux.collection.walk import Walk, run_walks
from deux.contracts import Robot
from deux.figures.drawing import new_figure
from deux.figures.trajectory import OCCUPANCY_COLORS, extent
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.simulation import Simulation


def main(mesh: str | None = None, steps: int = 150) -> None:
    """Let `frontier` walk on the largest floor, and write exploration.gif: what it sees, and its map."""
    source = registry().create("scenes", "files" if mesh else "apartments", {"train": [mesh] if mesh else 1})
    simulation = Simulation(Camera(160, 120), Robot(), registry().choose("simulators", {"name": "mesh"}))
    explorer = registry().create("explorers", "frontier", {})
    walk = Walk(simulation.make(source.splits().train[0]), explorer, seed=0, steps=int(steps))
    seen = [(step.frame.rgb, step.frame.pose[[0, 2], 3], explorer.map()) for (step,) in run_walks([walk])]
    left, right = (figure := new_figure(9, 4)).subplots(1, 2)

    def draw(number: int) -> None:
        rgb, _, known = seen[number]
        left.clear(), right.clear()
        left.imshow(rgb)
        right.imshow(known.occupancy, cmap=OCCUPANCY_COLORS, vmin=0, vmax=2, extent=extent(known.frame))
        right.plot(*np.transpose([place for _, place, _ in seen[: number + 1]]), color="tab:red")

    FuncAnimation(figure, draw, range(0, len(seen), 3)).save("exploration.gif", PillowWriter(fps=8))


if __name__ == "__main__":
    main(*sys.argv[1:])
