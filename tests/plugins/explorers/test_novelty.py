from deux.testing.learned_explorers import LearnedExplorerSuite
from deux_plugins.explorers.novelty import NoveltyExplorer


class TestNoveltyExplorer(LearnedExplorerSuite):
    explorer_class = NoveltyExplorer
