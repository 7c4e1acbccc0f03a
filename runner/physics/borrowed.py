"""Arrays that compiled code may use without counting who else does.

Numba counts the users of an array's memory, by an atomic addition each time that a function is handed the array or a
part of it and another when it is done. In functions that are called a million times a second with some ten arrays, that
was three quarters of their time, and more where two threads count the users of the same memory.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic


def _without_owner(typing_context, array):
    if not isinstance(array, types.Array):
        raise TypingError("only arrays are borrowed")

    def codegen(context, builder, signature, args):
        view = context.make_array(signature.args[0])(context, builder, args[0])
        for name in ("meminfo", "parent"):  # nobody's: then there is nothing to count
            field = getattr(view, name)
            setattr(view, name, cgutils.get_null_value(field.type))
        return view._getvalue()

    return array(array), codegen


# The same array without its owner, in compiled code. The owner must outlive it: an argument of the function that
# borrows does, what that function itself made does until its last use there.
borrowed: Any = intrinsic(_without_owner)
