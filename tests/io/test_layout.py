from deux.io.layout import neighbours


def test_targets_have_all_their_source_frames() -> None:
    assert neighbours(["a", "b", "c", "d"], (-1, -2)) == [("c", "b", "a"), ("d", "c", "b")]
    assert neighbours(["a", "b", "c", "d"], (-1, 1)) == [("b", "a", "c"), ("c", "b", "d")]
    assert neighbours(["a", "b"], (-1, -2)) == []
    assert neighbours([str(i) for i in range(30)], (-10, 10)) == [
        (str(i), str(i - 10), str(i + 10)) for i in range(10, 20)
    ]
