"""The semantic labels of generated flats."""

LABEL_NAMES: tuple[str, ...] = (
    "wall", "floor", "ceiling", "door frame", "door", "window",
    "bed", "nightstand", "wardrobe", "cabinet", "sofa", "armchair", "chair", "stool", "table", "desk", "shelf",
    "counter", "refrigerator", "stove", "sink", "bathtub", "toilet", "washing machine", "coat rack", "radiator",
    "tv", "computer", "lamp", "plant", "rug", "picture", "curtain", "cushion", "book", "vase", "box",
)  # fmt: skip
"""The labels of every flat, whatever it contains; a face's label is an index into this tuple."""

STRUCTURE: frozenset[str] = frozenset({"wall", "floor", "ceiling", "door frame", "door", "window"})
"""The labels that belong to the building; all others are furniture."""

LABEL_INDEX: dict[str, int] = {name: index for index, name in enumerate(LABEL_NAMES)}
"""Index of each label."""
