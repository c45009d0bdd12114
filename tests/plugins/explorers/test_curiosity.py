from deux.testing.learned_explorers import LearnedExplorerSuite
from deux_plugins.explorers.curiosity import CuriosityExplorer


class TestCuriosityExplorer(LearnedExplorerSuite):
    explorer_class = CuriosityExplorer
