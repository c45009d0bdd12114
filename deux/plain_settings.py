"""OmegaConf nodes as plain dictionaries and lists, with interpolations (${...}) resolved."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import InterpolationKeyError, MissingMandatoryValue, OmegaConfBaseException

from deux.errors import DeuxError, shown


def plain(settings: Any, where: str) -> Any:
    """Convert settings to plain dictionaries and lists; interpolations are resolved, missing values ("???") left out.

    Raises:
        DeuxError: an interpolation cannot be resolved.
    """
    if OmegaConf.is_config(settings):
        with references_resolved(where):
            settings = OmegaConf.to_container(settings, resolve=True)
    if isinstance(settings, Mapping):
        return {str(key): plain(value, f"{where}.{key}") for key, value in settings.items() if value != "???"}
    return settings


def plain_options(settings: Any, where: str) -> dict[str, Any]:
    """As `plain`, for a node that must be a mapping.

    Raises:
        DeuxError: as `plain`; or it is a single value or a list.
    """
    found = plain(settings, where)
    if not isinstance(found, Mapping):
        raise DeuxError(f"{where} holds options by name, as in {where}.<option>=<value>, but is {shown(found)}.")
    return dict(found)


@contextmanager
def references_resolved(where: str) -> Iterator[None]:
    """Turn OmegaConf's errors about interpolations into DeuxErrors that name the option.

    Args:
        where: path of the node that is read, such as "camera".
    """
    try:
        yield
    except InterpolationKeyError as error:
        raise DeuxError(unresolved_reference(error, where)) from error
    except MissingMandatoryValue as error:
        raise DeuxError(f"{error.full_key or where} has no value: give it one.") from error
    except OmegaConfBaseException as error:
        raise DeuxError(f"{where} cannot be resolved: {str(error).splitlines()[0]}.") from error
    except RecursionError as error:
        raise DeuxError(f"{where} refers by ${{...}} to itself, or is nested too deeply.") from error


def unresolved_reference(error: InterpolationKeyError, where: str = "an option") -> str:
    """The message about an interpolation of an option that does not exist; `where` if the error names no option."""
    return (
        f"{error.full_key or where} refers by ${{...}} to an option that is not there: where the text itself is "
        "meant, write \\${...}."
    )
