from deux.report.display_names import Variant


def test_order_and_parts_are_as_listed_and_the_unlisted_come_last(names):
    variants = [
        Variant("wall"),
        Variant("deux", "t=2"),
        Variant("frontier"),
        Variant("deux", "t=1"),
        Variant("random"),
        Variant("arc"),
    ]
    assert names.explorer_parts(variants) == [
        [Variant("random"), Variant("frontier")],
        [Variant("deux", "t=1"), Variant("deux", "t=2")],
        [Variant("arc"), Variant("wall")],
    ]
    assert names.ordered_models([Variant("mine"), Variant("kbnet"), Variant("voiced")]) == [
        Variant("voiced"),
        Variant("kbnet"),
        Variant("mine"),
    ]


def test_variants_are_told_apart(names):
    assert names.explorer(Variant("deux")) == "DEUX"
    assert names.explorer(Variant("deux", "t=1")) == "DEUX (t=1)"
    assert names.model(Variant("mine")) == "mine"
