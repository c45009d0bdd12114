"""The semantic labels of generated flats and houses: first parts of the building, then furniture."""

LABEL_NAMES: tuple[str, ...] = (
    "wall", "floor", "ceiling", "door frame", "door", "window",
    "bed", "nightstand", "wardrobe", "cabinet", "sofa", "armchair", "chair", "stool", "table", "desk", "shelf",
    "counter", "refrigerator", "stove", "sink", "bathtub", "toilet", "washing machine", "coat rack", "radiator",
    "tv", "computer", "lamp", "plant", "rug", "picture", "curtain", "cushion", "book", "vase", "box",
)  # fmt: skip
"""The labels of every generated scene; a face's label is an index into this tuple."""

LABEL_INDEX: dict[str, int] = {name: index for index, name in enumerate(LABEL_NAMES)}
"""Index of each label."""
