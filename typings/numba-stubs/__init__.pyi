from collections.abc import Callable
from typing import Any, TypeVar, overload

F = TypeVar("F", bound=Callable[..., Any])

# what is compiled is called as what it was made of
@overload
def njit(function: F, /) -> F: ...
@overload
def njit(*signatures: Any, **options: Any) -> Callable[[F], F]: ...
def __getattr__(name: str) -> Any: ...
