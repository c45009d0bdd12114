"""Judged walks for the tests of the study of uncertainty."""

import numpy as np

from deux.studies.evaluated_walk import EvaluatedFrame, EvaluatedWalk, MeasureScores, Place


def one(delta: float, rank: float) -> MeasureScores:
    oracle = np.linspace(1.0, 0.05, 20)
    return MeasureScores(delta, 0.5, rank, (1.0 - rank) / 2.0, (rank * oracle + (1.0 - rank)).tolist(), oracle.tolist())


def walk(scene: str, sign: float, rank: float, floor: int = 0) -> EvaluatedWalk:
    """Ten frames whose l1 goes with the motion, and whose sparse_error goes with the error (or against it)."""
    rng = np.random.default_rng(0)
    frames = [
        EvaluatedFrame(
            step=step,
            moved=(moved := 0.5 * (step % 2)),
            turned=10.0,
            distance=2.0,
            texture=0.1,
            error=(error := 100.0 + 10.0 * step),
            scores={
                "l1": one(moved + 0.01 * rng.random(), 0.1),
                "sparse_error": one(sign * error, rank),
                **({"parallax": one(error, 0.3)} if moved else {}),
                "chance": one(rng.random(), 0.0),
            },
        )
        for step in range(10)
    ]
    places = [Place(uncertainty=float(i), error=float(i * i)) for i in range(5)]
    return EvaluatedWalk(scene, frames, {"l1": places[::-1], "sparse_error": places}, floor)
