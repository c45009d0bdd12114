"""Gymnasium environment for exploration: `gymnasium.make("deux.environment:deux/Exploration-v0")`."""

import gymnasium

ENVIRONMENT = "deux/Exploration-v0"

if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT, "deux.environment.exploration_env:ExplorationEnv")
