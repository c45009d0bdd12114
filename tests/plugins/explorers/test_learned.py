from deux.testing.learned_explorers import LearnedExplorerSuite
from deux_plugins.explorers.learned import (
    CoverageExplorer,
    CuriosityExplorer,
    NoveltyExplorer,
    SemanticReconstructionExplorer,
    SmoothCoverageExplorer,
)


class TestCoverageExplorer(LearnedExplorerSuite):
    explorer_class = CoverageExplorer


class TestSmoothCoverageExplorer(LearnedExplorerSuite):
    explorer_class = SmoothCoverageExplorer


class TestNoveltyExplorer(LearnedExplorerSuite):
    explorer_class = NoveltyExplorer


class TestCuriosityExplorer(LearnedExplorerSuite):
    explorer_class = CuriosityExplorer


class TestSemanticReconstructionExplorer(LearnedExplorerSuite):
    explorer_class = SemanticReconstructionExplorer
