"""Which laws a compiled function is for: known when it runs, or already when it is compiled.

The same source serves both. Given an array of codes, one compiled function runs any choice of laws: what the
diagnosis needs, which tries many. Given a ``LawChoice``, the choice is part of the type, so that everything
that is not active disappears at compile time: what large batches need.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import NativeValue, intrinsic, models, overload, register_model, typeof_impl, unbox


class LawChoice:
    """A choice of laws as a compile-time constant.

    Args:
        codes: (families,) code of the chosen member of each ``Family``.
    """

    def __init__(self, codes: np.ndarray) -> None:
        self.codes = tuple(int(code) for code in codes)


class LawChoiceType(types.Type):
    """Numba's type of one choice of laws."""

    def __init__(self, codes: tuple[int, ...]) -> None:
        self.codes = codes
        super().__init__(name=f"LawChoice{codes}")


@typeof_impl.register(LawChoice)
def _typeof_choice(value: LawChoice, context: Any) -> LawChoiceType:
    return LawChoiceType(value.codes)


@register_model(LawChoiceType)
class _LawChoiceModel(models.OpaqueModel):
    """No data at run time."""


@unbox(LawChoiceType)
def _unbox_choice(typ: Any, obj: Any, c: Any) -> NativeValue:
    return NativeValue(c.context.get_dummy_value())


def chosen(codes: Any, family: int) -> int:
    """Code of the chosen member of a family, from an array of codes or a ``LawChoice``."""
    return (codes.codes if isinstance(codes, LawChoice) else codes)[family]


@intrinsic
def _constant_code(typingctx: Any, codes: Any, family: Any) -> Any:
    if not isinstance(codes, LawChoiceType):
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        table = ir.Constant(ir.VectorType(ir.IntType(64), len(codes.codes)), list(codes.codes))
        return builder.extract_element(table, args[1])

    return types.int64(codes, types.int64), generate


@overload(chosen, jit_options={"forceinline": True})
def _chosen(codes: Any, family: int) -> Any:
    def constant(codes: Any, family: int) -> int:
        return _constant_code(codes, family)

    def variable(codes: Any, family: int) -> int:
        return codes[family]

    return constant if isinstance(codes, LawChoiceType) else variable
