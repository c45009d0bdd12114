"""How wrong a depth map may be, judged without its ground truth: several measures behind one interface.

`deux.uncertainty.measures` lists them; each other file holds one kind.
"""
