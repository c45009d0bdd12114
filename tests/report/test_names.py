def test_order_and_parts_are_as_listed_and_the_unlisted_come_last(names):
    keys = [("wall", ""), ("deux", "t=2"), ("frontier", ""), ("deux", "t=1"), ("random", ""), ("arc", "")]
    assert names.explorer_parts(keys) == [
        [("random", ""), ("frontier", "")],
        [("deux", "t=1"), ("deux", "t=2")],
        [("arc", ""), ("wall", "")],
    ]
    assert names.ordered_models([("mine", ""), ("kbnet", ""), ("voiced", "")]) == [
        ("voiced", ""),
        ("kbnet", ""),
        ("mine", ""),
    ]


def test_variants_are_told_apart(names):
    assert names.explorer(("deux", "")) == "DEUX"
    assert names.explorer(("deux", "t=1")) == "DEUX (t=1)"
    assert names.model(("mine", "")) == "mine"
