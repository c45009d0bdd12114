"""The one error that a user's mistake raises, the one that says so of a sweep's job, and parts of their sentences."""

import difflib
import math
import re
from collections.abc import Iterable, Sequence

_PLURAL_VERBS = {"is": "are", "has": "have", "does": "do"}
_BLANKS = str.maketrans("\n\r\t", "   ")
_LONGEST_WORD = 400
"""Characters in a row that a message shows: names of files are shorter."""


class DeuxError(Exception):
    """A mistake of the user's: one sentence that says what is wrong, where, and what would be right.

    The command line prints the sentence without a stack trace and exits with code 1. Names and values from outside may
    be part of it: line breaks become blanks, what no console prints as it is, such as escapes, is written as Python
    writes it, and words of more than 400 characters are cut.

    Args:
        message: the sentence.

    Example:
        >>> print(DeuxError("there is no file\\n\\x1b[31m.png."))
        there is no file \\x1b[31m.png.
    """

    def __init__(self, message: object = "") -> None:
        text = printable(str(message))
        super().__init__(re.sub(rf"\S{{{_LONGEST_WORD},}}", lambda word: f"{word[0][:_LONGEST_WORD]}...", text))


class JobFailed(DeuxError):
    """A job of a sweep failed, in this process or in another one, where the error itself was told.

    Stands for errors of any kind, some of which cannot be sent from one process to another.
    """


def printable(text: str) -> str:
    """Text on one line as it may be printed: nothing in it moves a terminal's cursor or turns its text around.

    Line breaks and tabs become blanks; what no console prints as it is, is written as Python writes it.

    Example:
        >>> printable("a\\x1b[31m b\\nc")
        'a\\\\x1b[31m b c'
    """
    text = text.translate(_BLANKS)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def near_matches(wrong: str, known: Iterable[str]) -> str:
    """Which of the `known` names could have been meant by `wrong`, then all of them: the end of a sentence.

    Example:
        >>> near_matches("kbnt", ["kbnet", "voiced"]), near_matches("x", [])
        ('did you mean kbnet? There is: kbnet, voiced.', 'there is: none.')
    """
    names = sorted(known)
    listed = f"here is: {', '.join(names) or 'none'}."
    close = difflib.get_close_matches(wrong, names, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}? T{listed}" if close else f"t{listed}"


def plural(word: str, count: int) -> str:
    """A noun, or the verb "is", "has" or "does", as it stands with a number: in the singular with 1 only.

    Example:
        >>> plural("test scene", 1), plural("test scene", 2), plural("has", 0)
        ('test scene', 'test scenes', 'have')
    """
    return word if count == 1 else _PLURAL_VERBS.get(word, f"{word}s")


def counted(count: int, noun: str) -> str:
    """How many there are of something.

    Example:
        >>> counted(1, "run"), counted(12, "run")
        ('1 run', '12 runs')
    """
    return f"{count} {plural(noun, count)}"


def shown(value: object, most: int = 80) -> str:
    """A value from outside for a message: as Python writes it, cut where it is long.

    Example:
        >>> shown([1, 2]), shown("x" * 1000, most=10), shown(10**10_000)
        ('[1, 2]', "'xxxxxx...", 'a value of the type int')
    """
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # numbers of thousands of digits, lists in lists
        text = f"a value of the type {type(value).__name__}"
    return text if len(text) <= most else f"{text[: most - 3]}..."


def error_text(error: BaseException, most: int = 300) -> str:
    """The message of a library's error as part of a sentence: on one line, cut if it is long, without a full stop.

    Example:
        >>> error_text(ValueError("no such\\n  key.")), error_text(KeyError())
        ('no such key', 'KeyError')
    """
    text = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return text if len(text) <= most else f"{text[:most]}..."


def sizes(shape: Iterable[int]) -> str:
    """The shape of an array or tensor for a message.

    Example:
        >>> sizes((2, 3)), sizes(())
        ('2 x 3', 'a single number')
    """
    return " x ".join(map(str, shape)) or "a single number"


def image_size(shape: Sequence[int]) -> str:
    """The size of an image for a message: the width first, as cameras and viewers give it.

    Args:
        shape: its height and width; what follows, such as the colours, does not matter.

    Example:
        >>> image_size((480, 640, 3))
        '640 x 480'
    """
    return f"{shape[1]} x {shape[0]}"


def kind_of(value: object) -> str:
    """What a value is, for a message that has no use for its content: a tensor is not read, nor its device waited for.

    Example:
        >>> kind_of(None), kind_of(0.5)
        ('None', 'a value of the type float')
    """
    if value is None:
        return "None"
    shape, dtype = getattr(value, "shape", None), getattr(value, "dtype", None)
    if not isinstance(shape, tuple) or dtype is None:
        return f"a value of the type {type(value).__name__}"
    kind = str(dtype).removeprefix("torch.")
    return f"{type(value).__name__} of {sizes(shape)}, {kind}"


def check_range(
    name: str, value: float, least: float = -math.inf, most: float = math.inf, *, ends: bool = True
) -> None:
    """Raise DeuxError unless a number lies between `least` and `most`; NaN lies nowhere.

    Args:
        name: what the number is called, such as "camera.hfov"; it begins the message.
        value: the number.
        least: the lower end.
        most: the upper end.
        ends: whether the ends belong to the range.
    """
    if least <= value <= most and (ends or value not in (least, most)):
        return
    limits = {("at least" if ends else "above"): least, ("at most" if ends else "below"): most}
    wanted = " and ".join(f"{word} {limit}" for word, limit in limits.items() if math.isfinite(limit))
    finite = "a finite number " if value in (math.inf, -math.inf) else ""
    raise DeuxError(f"{name} is {value}: it must be {finite}{wanted}.")
