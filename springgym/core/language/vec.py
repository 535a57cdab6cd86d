"""`Vec`: three numbers of every copy as one value, with ``+``, ``-`` and ``*`` as on paper.

In compiled functions ``u + w``, ``u - w``, ``s * u`` and ``-u`` act component by component, and each
operation is rounded, as in the same formula on numbers; `springgym.core.language.vectors.plus_scaled` rounds
a product and a sum once. ``u[0]`` is a component. All copies share a vector of plain numbers; mixing it with
`Lanes` broadcasts."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model

from springgym.core.compiler.numba_private import AbstractTemplate, infer, infer_global, ir, signature
from springgym.core.language.lanes import Lanes, as_lanes


class Vec(types.Type):
    """Numba type of a vector; ``of`` is the type of its components: `Lanes`, or a float."""

    def __init__(self, of: types.Type) -> None:
        self.of = of
        super().__init__(name=f"Vec({of})")


@register_model(Vec)
class _VecModel(models.StructModel):
    def __init__(self, manager, kind: Vec) -> None:
        super().__init__(manager, kind, [(axis, kind.of) for axis in "xyz"])


def _component(kind: types.Type) -> types.Type:
    return kind.of if isinstance(kind, Vec) else kind


def _common(kinds: tuple[types.Type, ...]) -> types.Type | None:
    """Return the type of the components of a result of these operands; None if they do not fit."""
    components = [_component(kind) for kind in kinds]
    if not all(isinstance(one, (Lanes, types.Number)) for one in components):
        return None
    found = {one for one in components if isinstance(one, Lanes)}
    if len(found) > 1:
        return None
    return found.pop() if found else types.float64


def _components(context, builder, value, given: types.Type, of: types.Type) -> list[Any]:
    """Return the three components of a vector, or a number three times."""
    if isinstance(given, Vec):
        parts = [builder.extract_value(value, axis) for axis in range(3)]
        return [as_lanes(context, builder, part, given.of, of) for part in parts]
    return [as_lanes(context, builder, value, given, of)] * 3


def _made(context, builder, kind: Vec, parts: list[Any]):
    """Build the vector of three components."""
    value = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for axis, part in enumerate(parts):
        value = builder.insert_value(value, part, axis)
    return value


@intrinsic
def vec(typingctx, x, y, z):
    """Build the vector (x, y, z)."""
    of = _common((x, y, z))

    def codegen(context, builder, sig, args):
        parts = [as_lanes(context, builder, v, t, of) for v, t in zip(args, sig.args, strict=True)]
        return _made(context, builder, sig.return_type, parts)

    return of and Vec(of)(x, y, z), codegen


# --- Operators --------------------------------------------------------------------------------------


def _define(function: Callable[..., Any], emit: str, *takes: tuple[type, ...]) -> None:
    """Define an operator on vectors by one LLVM instruction for each component."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            if not any(len(kinds) == len(args) and all(map(isinstance, args, kinds)) for kinds in takes):
                return None
            of = _common(args)
            return of and signature(Vec(of), *args)

    def lower(context, builder, sig, args):
        kind = sig.return_type
        sides = [_components(context, builder, v, t, kind.of) for v, t in zip(args, sig.args, strict=True)]
        parts = [getattr(builder, emit)(*operands) for operands in zip(*sides, strict=True)]
        return _made(context, builder, kind, parts)

    for kinds in takes:
        lower_builtin(function, *kinds)(lower)


_define(operator.add, "fadd", (Vec, Vec))
_define(operator.sub, "fsub", (Vec, Vec))
_define(operator.mul, "fmul", (Lanes, Vec), (types.Number, Vec))
_define(operator.neg, "fneg", (Vec,))


@infer
class _Component(AbstractTemplate):
    key = "static_getitem"

    def generic(self, args, kws):
        vector, index = args
        return signature(vector.of, *args) if isinstance(vector, Vec) and index in (0, 1, 2) else None


@lower_builtin("static_getitem", Vec, types.Any)
def _component_of(context, builder, sig, args):
    return builder.extract_value(args[0], args[1])


@infer_global(operator.getitem)
class _SomeComponent(AbstractTemplate):
    def generic(self, args, kws):
        vector, index = args
        fits = isinstance(vector, Vec) and isinstance(index, types.Integer)
        return signature(vector.of, vector, types.intp) if fits else None


@lower_builtin(operator.getitem, Vec, types.Integer)
def _some_component(context, builder, sig, args):
    vector, index = args
    found = builder.extract_value(vector, 0)
    for axis in (1, 2):
        here = builder.icmp_signed("==", index, ir.Constant(index.type, axis))
        found = builder.select(here, builder.extract_value(vector, axis), found)
    return found
