"""Numbers that are one double or sixteen doubles in lockstep.

Every law of the machine is written once, in plain scalar arithmetic. Called with ``float`` it computes one
run; called with ``Lanes`` it computes ``WIDTH`` runs at once, one per vector lane, which is how a batch fills
the processor's vector units without relying on a compiler to find the parallelism. The functions ``get``,
``put``, ``where`` and the mathematical functions below are all that a law needs beyond ``+ - * /`` and
comparisons. Lanes never exchange values, so the result of a run does not depend on its neighbours.
"""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, overload, register_model

from clearance.compilation import kernel

WIDTH = 16  # two 512-bit registers: one hides the latency of the other

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_FAST = ("contract", "nsz")  # a*b+c may fuse, x+0 is x; nothing may be reordered


class LanesType(types.Type):
    """Numba's type of ``WIDTH`` doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{WIDTH}")

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Any:
        """A number becomes lanes by repetition."""
        from numba.core.typeconv import Conversion

        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, typingctx: Any, other: types.Type) -> Any:
        """A variable that is a number on one path and lanes on another is lanes."""
        return self if isinstance(other, types.Number) else None


class MaskType(types.Type):
    """Numba's type of ``WIDTH`` truth values."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask{WIDTH}")


LANES = LanesType()
MASK = MaskType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, _VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, ir.VectorType(ir.IntType(1), WIDTH))


def _splat(builder: Any, scalar: Any) -> Any:
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)


@lower_cast(types.Number, LanesType)
def _number_to_lanes(context: Any, builder: Any, fromty: types.Type, toty: types.Type, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, fromty, types.float64))


def _register_binary(
    symbol: Callable[..., Any], emit: Callable[..., Any], result: types.Type, operand: types.Type
) -> None:
    @infer_global(symbol)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and operand in args:
                other = args[1] if args[0] is operand else args[0]
                if other is operand or (operand is LANES and isinstance(other, types.Number)):
                    return signature(result, operand, operand)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)

    lower_builtin(symbol, type(operand), type(operand))(lower)


for _symbol, _method in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    for _operator in (_symbol, getattr(operator, "i" + _symbol.__name__)):
        _register_binary(_operator, lambda b, x, y, m=_method: getattr(b, m)(x, y, flags=_FAST), LANES, LANES)
for _symbol, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _register_binary(_symbol, lambda b, x, y, s=_sign: b.fcmp_ordered(s, x, y), MASK, LANES)
_register_binary(operator.and_, lambda b, x, y: b.and_(x, y), MASK, MASK)
_register_binary(operator.or_, lambda b, x, y: b.or_(x, y), MASK, MASK)


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(LANES, LANES) if args == (LANES,) else None


@lower_builtin(operator.neg, LanesType)
def _lower_negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fsub(ir.Constant(_VECTOR, [-0.0] * WIDTH), args[0])


def _call_llvm(builder: Any, name: str, *args: Any) -> Any:
    kinds = [a.type for a in args]
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_VECTOR, kinds), f"llvm.{name}.v{WIDTH}f64"
    )
    return builder.call(function, args)


def _llvm_unary(name: str) -> Any:
    @intrinsic
    def unary(typingctx: Any, x: Any) -> Any:
        if x is not LANES:
            return None
        return LANES(LANES), lambda context, builder, sig, args: _call_llvm(builder, name, args[0])

    return unary


_lanes_sqrt = _llvm_unary("sqrt")
_lanes_abs = _llvm_unary("fabs")
_lanes_rint = _llvm_unary("rint")
_lanes_exp = _llvm_unary("exp")  # no vector instruction: lane by lane, for rarely used laws
_lanes_log = _llvm_unary("log")
_lanes_arcsine = _llvm_unary("asin")


@intrinsic
def _lanes_select(typingctx: Any, mask: Any, a: Any, b: Any) -> Any:
    if mask is not MASK:
        return None
    return LANES(MASK, LANES, LANES), lambda context, builder, sig, args: builder.select(*args)


@intrinsic
def _mask_any(typingctx: Any, mask: Any) -> Any:
    if mask is not MASK:
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(MASK), generate


def _row_pointer(context: Any, builder: Any, array_type: Any, array: Any, row: Any) -> Any:
    """Address of row ``row`` of a C-contiguous (rows, WIDTH) array, as a vector."""
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.gep(data, [builder.mul(row, ir.Constant(row.type, WIDTH))])
    return builder.bitcast(first, _VECTOR.as_pointer())


@intrinsic
def _load_row(typingctx: Any, array: Any, row: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(_row_pointer(context, builder, sig.args[0], args[0], args[1]))
        value.align = 8
        return value

    return LANES(array, types.intp), generate


@intrinsic
def _store_row(typingctx: Any, array: Any, row: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        store = builder.store(args[2], _row_pointer(context, builder, sig.args[0], args[0], args[1]))
        store.align = 8
        return context.get_dummy_value()

    return types.none(array, types.intp, LANES), generate


def get(array: Any, row: int) -> Any:
    """Row ``row`` of a (rows,) array as a float, or of a (rows, WIDTH) array as lanes."""
    return array[row]


def put(array: Any, row: int, value: Any) -> None:
    """Store ``value`` in row ``row``; the counterpart of ``get``."""
    array[row] = value


def where(condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition holds, else ``b``; both are computed."""
    return np.where(condition, a, b)


def any_lane(condition: Any) -> bool:
    """Whether the condition holds in at least one lane."""
    return bool(np.any(condition))


def zero(like: Any) -> Any:
    """Zero of the type of ``like``; a constant, unlike ``0.0 * like``."""
    return np.zeros_like(like)


def square_root(x: Any) -> Any:
    """Square root."""
    return np.sqrt(x)


def absolute(x: Any) -> Any:
    """Magnitude."""
    return np.abs(x)


def nearest_integer(x: Any) -> Any:
    """Nearest integer, ties to even."""
    return np.rint(x)


def arcsine(x: Any) -> Any:
    """Angle of a sine, in [-pi/2, pi/2]."""
    return np.arcsin(x)


def exponential(x: Any) -> Any:
    """The exponential function."""
    return np.exp(x)


def logarithm(x: Any) -> Any:
    """The natural logarithm."""
    return np.log(x)


_INLINE = {"forceinline": True}


# Numba compares an overload's own signature with that of the function it replaces, annotations included.
@overload(get, jit_options=_INLINE)
def _get(array: Any, row: int) -> Any:
    def element(array: Any, row: int) -> Any:
        return array[row]

    def lanes(array: Any, row: int) -> Any:
        return _load_row(array, row)

    return element if array.ndim == 1 else lanes


@overload(put, jit_options=_INLINE)
def _put(array: Any, row: int, value: Any) -> Any:
    def element(array: Any, row: int, value: Any) -> None:
        array[row] = value

    def lanes(array: Any, row: int, value: Any) -> None:
        _store_row(array, row, value)

    return element if array.ndim == 1 else lanes


@overload(where, jit_options=_INLINE)
def _where(condition: Any, a: Any, b: Any) -> Any:
    def one(condition: Any, a: Any, b: Any) -> Any:
        return a if condition else b

    def lanes(condition: Any, a: Any, b: Any) -> Any:
        return _lanes_select(condition, a, b)

    return lanes if condition is MASK else one


@overload(any_lane, jit_options=_INLINE)
def _any_lane(condition: Any) -> Any:
    def one(condition: Any) -> bool:
        return condition

    def lanes(condition: Any) -> bool:
        return _mask_any(condition)

    return lanes if condition is MASK else one


@intrinsic
def _lanes_zero(typingctx: Any, like: Any) -> Any:
    if like is not LANES:
        return None
    return LANES(LANES), lambda context, builder, sig, args: ir.Constant(_VECTOR, [0.0] * WIDTH)


@overload(zero, jit_options=_INLINE)
def _zero(like: Any) -> Any:
    def one(like: Any) -> float:
        return 0.0

    def lanes(like: Any) -> Any:
        return _lanes_zero(like)

    return lanes if like is LANES else one


def _overload_unary(function: Any, of_lanes: Any, of_float: Any) -> None:
    def one(x: Any) -> Any:
        return of_float(x)

    def lanes(x: Any) -> Any:
        return of_lanes(x)

    @overload(function, jit_options=_INLINE)
    def choose(x: Any) -> Any:
        return lanes if x is LANES else one


_overload_unary(square_root, _lanes_sqrt, np.sqrt)
_overload_unary(absolute, _lanes_abs, np.abs)
_overload_unary(nearest_integer, _lanes_rint, np.rint)
_overload_unary(exponential, _lanes_exp, np.exp)
_overload_unary(logarithm, _lanes_log, np.log)
_overload_unary(arcsine, _lanes_arcsine, np.arcsin)


@kernel
def maximum(a: Any, b: Any) -> Any:
    """The larger of two; ``a`` where they do not compare."""
    return where(b > a, b, a)


@kernel
def minimum(a: Any, b: Any) -> Any:
    """The smaller of two; ``a`` where they do not compare."""
    return where(b < a, b, a)


# pi in two parts: the first has 31 bits, so that its product with any turn count below 2**22 is exact.
_PI_HIGH = 3.1415926534682512
_PI_LOW = 1.2154201013012384e-10


@kernel
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Sine and cosine of an angle [rad], within 4e-16 for |x| < 1e6.

    The angle is reduced to half a turn around zero, where the Taylor series to degree 21 leaves less than
    1e-17. Written out here because a library call has no vector form on every machine.
    """
    turns = nearest_integer(x * (1.0 / np.pi))
    r = (x - turns * _PI_HIGH) - turns * _PI_LOW
    odd = absolute(turns * 0.5 - nearest_integer(turns * 0.5))
    sign = 1.0 - 4.0 * odd
    z = r * r
    s = 1.0 / 51090942171709440000.0
    s = s * z - 1.0 / 121645100408832000.0
    s = s * z + 1.0 / 355687428096000.0
    s = s * z - 1.0 / 1307674368000.0
    s = s * z + 1.0 / 6227020800.0
    s = s * z - 1.0 / 39916800.0
    s = s * z + 1.0 / 362880.0
    s = s * z - 1.0 / 5040.0
    s = s * z + 1.0 / 120.0
    s = s * z - 1.0 / 6.0
    s = r + r * (z * s)
    c = -1.0 / 1124000727777607680000.0
    c = c * z + 1.0 / 2432902008176640000.0
    c = c * z - 1.0 / 6402373705728000.0
    c = c * z + 1.0 / 20922789888000.0
    c = c * z - 1.0 / 87178291200.0
    c = c * z + 1.0 / 479001600.0
    c = c * z - 1.0 / 3628800.0
    c = c * z + 1.0 / 40320.0
    c = c * z - 1.0 / 720.0
    c = c * z + 1.0 / 24.0
    c = c * z - 0.5
    c = 1.0 + z * c
    return sign * s, sign * c
