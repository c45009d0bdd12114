"""Flats that several tests look at."""

import pytest

from deux.contracts import Scene
from deux_plugins.scenes.apartments import apartment

SEEDS = (0, 1, 2, 3)


@pytest.fixture(scope="session")
def flats() -> dict[int, Scene]:
    return {seed: apartment(seed) for seed in SEEDS}


@pytest.fixture(scope="session", params=SEEDS)
def flat(request: pytest.FixtureRequest, flats: dict[int, Scene]) -> Scene:
    return flats[request.param]
