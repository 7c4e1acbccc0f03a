"""What a file may hold, as pydantic's models, and what they refuse as one line: the place, what must be there, what is.

pydantic and not msgspec: its errors are data (place, value, kind), of which a line with the key, the unit and the
nearest name can be made. Those of msgspec are sentences without the value.
"""

from __future__ import annotations

import re
import reprlib
from typing import Any

from pydantic import BaseModel, ValidationError, ValidatorFunctionWrapHandler, WrapValidator, model_validator
from pydantic_core import PydanticCustomError

from runner.errors import nearest

Place = tuple[str | int, ...]
_SAID = ("refused", "missing", "extra_forbidden")


class Keys(BaseModel):
    """A mapping with at least these keys. One that is absent is null: both are refused in the same words."""

    @model_validator(mode="before")
    @classmethod
    def _absent_is_null(cls, value: Any) -> Any:
        return dict.fromkeys(cls.model_fields) | value if isinstance(value, dict) else value


def must(words: str) -> WrapValidator:
    """Return an annotation that says what a value must be in these words, with its unit, in place of pydantic's.

    What is wrong further inside keeps the words that it has there, and keys stay what they are.
    """

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError as error:
            if all(e["type"] in _SAID for e in error.errors()):
                raise
            raise refused(f"must {words}, got {reprlib.repr(value)}.") from None

    return WrapValidator(check)


def refused(text: str) -> PydanticCustomError:
    """Return an error for a validator to raise, whose text stays as it is."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def refusal(error: ValidationError) -> tuple[Place, str]:
    """Return where the first thing is wrong, and what."""
    first = error.errors()[0]
    if first["type"] == "refused":
        text = first["msg"]
    elif first["type"] == "enum":
        valid = re.findall(r"'([^']*)'", first.get("ctx", {})["expected"])
        text = f"unknown '{first['input']}'. {nearest(str(first['input']), valid)}"
    else:
        text = f"{first['msg'].replace('Input should', 'must')}, got {reprlib.repr(first['input'])}."
    return first["loc"], text


def dotted(place: Place) -> str:
    """Return a place as it is written in messages: `effects.friction.mu`, `half_size[1]`."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place).lstrip(".")
