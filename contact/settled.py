"""Attributes that cannot be assigned a second time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Kind = TypeVar("Kind", bound=type)


def settled(remedy: str, *names: str) -> Callable[[Kind], Kind]:
    """Class decorator: setting one of the attributes `names` a second time raises an AttributeError
    with the remedy, as values computed from it would not follow. The class itself may change it,
    through ``self.__dict__``."""

    def decorate(kind: Kind) -> Kind:
        for name in names:
            setattr(kind, name, _Settled(name, remedy))
        return kind

    return decorate


class _Settled:
    def __init__(self, name: str, remedy: str) -> None:
        self.name, self.remedy = name, remedy

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        try:
            return instance.__dict__[self.name]
        except KeyError:
            raise AttributeError(f"{type(instance).__name__} has no {self.name} yet") from None

    def __set__(self, instance: Any, value: Any) -> None:
        if self.name in instance.__dict__:
            raise AttributeError(
                f"{type(instance).__name__}.{self.name} cannot be changed: {self.remedy}"
            )
        instance.__dict__[self.name] = value
