"""The exceptions for mistakes of the user, and helpers for their messages."""

import difflib
import math
import re
from collections.abc import Iterable, Sequence

_PLURAL_VERBS = {"is": "are", "has": "have", "does": "do"}
_BLANKS = str.maketrans("\n\r\t", "   ")
_LONGEST_WORD = 400
"""Maximal length of a word in a message; file names are shorter."""


class DeuxError(Exception):
    """A mistake of the user; its message is one sentence on what is wrong, where, and what would be right.

    The command line prints the message without a stack trace and exits with code 1. As it may contain untrusted names
    and values, line breaks become blanks, unprintable characters such as escapes are escaped as in Python, and words of
    more than 400 characters are cut.

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
    """A job of a sweep failed, in this or another process; the error itself was reported there.

    It represents errors of any type, some of which cannot be pickled.
    """


def printable(text: str) -> str:
    """Make text safe for printing on one line, without terminal control characters or changes of text direction.

    Line breaks and tabs become blanks; unprintable characters are escaped as in Python.

    Example:
        >>> printable("a\\x1b[31m b\\nc")
        'a\\\\x1b[31m b c'
    """
    text = text.translate(_BLANKS)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def near_matches(wrong: str, known: Iterable[str]) -> str:
    """Suggest similar names and list all `known` names, as the end of a sentence.

    Example:
        >>> near_matches("kbnt", ["kbnet", "voiced"]), near_matches("x", [])
        ('did you mean kbnet? There is: kbnet, voiced.', 'there is: none.')
    """
    names = sorted(known)
    listed = f"here is: {', '.join(names) or 'none'}."
    close = difflib.get_close_matches(wrong, names, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}? T{listed}" if close else f"t{listed}"


def plural(word: str, count: int) -> str:
    """A noun, or the verb "is", "has" or "does", in singular or plural according to a count.

    Example:
        >>> plural("test scene", 1), plural("test scene", 2), plural("has", 0)
        ('test scene', 'test scenes', 'have')
    """
    return word if count == 1 else _PLURAL_VERBS.get(word, f"{word}s")


def counted(count: int, noun: str) -> str:
    """A count with its noun.

    Example:
        >>> counted(1, "run"), counted(12, "run")
        ('1 run', '12 runs')
    """
    return f"{count} {plural(noun, count)}"


def shown(value: object, most: int = 80) -> str:
    """The `repr` of an untrusted value for a message, cut to `most` characters.

    Example:
        >>> shown([1, 2]), shown("x" * 1000, most=10), shown(10**10_000)
        ('[1, 2]', "'xxxxxx...", 'a value of the type int')
    """
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # numbers with thousands of digits, deeply nested lists
        text = f"a value of the type {type(value).__name__}"
    return text if len(text) <= most else f"{text[: most - 3]}..."


def first_line(error: BaseException) -> str:
    """The type of an unexpected error and the first line of its message, without a full stop.

    Example:
        >>> first_line(OSError("no route to host.\\nTry again.")), first_line(KeyError())
        ('OSError: no route to host', 'KeyError')
    """
    line = str(error).strip().partition("\n")[0].rstrip(". ")
    return f"{type(error).__name__}: {line}" if line else type(error).__name__


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
    """The size of an image for a message, as width x height.

    Args:
        shape: height and width; further dimensions, such as channels, are ignored.

    Example:
        >>> image_size((480, 640, 3))
        '640 x 480'
    """
    return f"{shape[1]} x {shape[0]}"


def kind_of(value: object) -> str:
    """Type, shape and dtype of a value for a message; does not read tensors, which would synchronise with the GPU.

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
    """Raise DeuxError unless a number is in a range; NaN never is.

    Args:
        name: name of the number, such as "camera.hfov", with which the message begins.
        value: the number.
        least: lower limit.
        most: upper limit.
        ends: whether the limits belong to the range.
    """
    if least <= value <= most and (ends or value not in (least, most)):
        return
    limits = {("at least" if ends else "above"): least, ("at most" if ends else "below"): most}
    wanted = " and ".join(f"{word} {limit}" for word, limit in limits.items() if math.isfinite(limit))
    finite = "a finite number " if value in (math.inf, -math.inf) else ""
    raise DeuxError(f"{name} is {value}: it must be {finite}{wanted}.")
