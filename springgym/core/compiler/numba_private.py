"""All that springgym takes from the private side of Numba: no other file reaches into it.

Three things are built on it. `NEEDS` lists the private parts that each uses, and importing this module looks
for all of them, so that another version of Numba gives one message. Without a part of

- **the language** (`springgym.core.language`), nothing can run: an ImportError;
- **the cache**, every process compiles anew: a warning, see `springgym.core.compiler.cache`;
- **the pipelines**, Numba's own compile kernels, which takes longer: a warning.

Compiled code gives the same results in all cases. If you use another part, add it to the list; a test
compares the list with the code. There is no public replacement, hence the upper bound on Numba in
``pyproject.toml``.
"""

from __future__ import annotations

import dis
import gc
import inspect
import os
import pickle
import warnings
from collections import Counter
from collections.abc import Callable
from operator import attrgetter
from types import FunctionType, SimpleNamespace
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import numba
from llvmlite import binding, ir
from numba.extending import models, register_model

if TYPE_CHECKING:
    from numba.core.compiler import CompileResult as CompileResult
    from numba.core.compiler import StateDict
    from numba.core.compiler_machinery import PassManager
    from numba.core.cpu import CPUContext as CPUContext
    from numba.core.datamodel import DataModelManager
    from numba.core.typing.templates import Signature

    Asked: TypeAlias = Signature | tuple[numba.types.Type, ...]
    """Argument types for which Numba requests code."""

__all__ = [
    "AbstractTemplate",
    "CachedDispatcher",
    "Inner",
    "binding",
    "cgutils",
    "definition",
    "infer",
    "infer_global",
    "ir",
    "keep_in",
    "lacking",
    "pipelines",
    "read_result",
    "signature",
    "target_of",
    "written_result",
]

if numba.config.DISABLE_JIT:
    raise ImportError("springgym runs compiled code only: unset NUMBA_DISABLE_JIT")

# --- What is used -------------------------------------------------------------------------------------

NEEDS = {
    "language": (
        "core.base.BaseContext.cast(builder, val, fromty, toty)",
        "core.base.BaseContext.data_model_manager",
        "core.base.BaseContext.enable_boundscheck",
        "core.base.BaseContext.get_constant(ty, val)",
        "core.base.BaseContext.get_dummy_value()",
        "core.base.BaseContext.get_value_type(ty)",
        "core.base.BaseContext.make_tuple(builder, typ, values)",
        "core.base.BaseContext.unpack_value(builder, ty, ptr)",
        "core.callconv.CPUCallConv.return_user_exc(builder, exc, exc_args)",
        "core.cgutils.get_or_insert_function(module, fnty, name)",
        "core.cgutils.if_unlikely(builder, pred)",
        "core.cgutils.pointer_add(builder, ptr, offset)",
        "core.cgutils.printf(builder, format)",
        "core.cgutils.unpack_tuple(builder, tup)",
        "core.cgutils.voidptr_t",
        "core.cpu.CPUContext.call_conv",
        "core.datamodel.models.DataModel.as_argument(builder, value)",
        "core.datamodel.models.DataModel.from_argument(builder, value)",
        "core.datamodel.models.DataModel.get_argument_type()",
        "core.datamodel.models.StructModel.get_field_position(field)",
        "core.dispatcher.Dispatcher.compile(sig)",
        "core.dispatcher.Dispatcher.targetoptions",
        "core.dispatcher._DispatcherBase.get_call_template(args, kws)",
        "core.dispatcher._DispatcherBase.get_overload(sig)",
        "core.dispatcher._DispatcherBase.overloads",
        "core.extending._Intrinsic._defn",
        "core.registry.CPUDispatcher",
        "core.typing.templates.AbstractTemplate",
        "core.typing.templates.infer",
        "core.typing.templates.infer_global",
        "core.typing.templates.signature",
    ),
    "cache": (
        "core.base.BaseContext.refresh()",
        "core.codegen.CPUCodegen._engine",
        "core.codegen.CPUCodegen.magic_tuple()",
        "core.codegen.JitEngine._load_defined_symbols(mod)",
        "core.compiler.CompileResult._reduce()",
        "core.compiler.CompileResult._rebuild",
        "core.compiler_lock._CompilerLock.acquire()",
        "core.compiler_lock._CompilerLock.release()",
        "core.compiler_lock.global_compiler_lock",
        "core.cpu.CPUContext.codegen()",
        "core.dispatcher.Dispatcher._cache",
        "core.funcdesc.FunctionDescriptor.llvm_cpython_wrapper_name",
        "core.funcdesc.FunctionDescriptor.llvm_func_name",
        "core.serialize.dumps(obj)",
        "core.sigutils.normalize_signature(sig)",
    ),
    "pipelines": (
        "_dynfunc.make_function",
        "core.analysis.compute_cfg_from_blocks(blocks)",
        "core.analysis.compute_use_defs(blocks)",
        "core.analysis.must_use_alloca(blocks)",
        "core.base.BaseContext.insert_user_function(func, fndesc, libs)",
        "core.codegen.CPUCodeLibrary._final_module",
        "core.codegen.CPUCodeLibrary._get_module_for_linking()",
        "core.codegen.CPUCodeLibrary._linking_libraries",
        "core.codegen.CPUCodeLibrary._optimize_final_module()",
        "core.codegen.CPUCodeLibrary._optimize_functions(ll_module)",
        "core.codegen.CodeLibrary.finalize()",
        "core.codegen.CPUCodegen._data_layout",
        "core.codegen.CPUCodegen._module_pass_manager",
        "core.codegen.CodeLibrary._codegen",
        "core.codegen.CodeLibrary._finalized",
        "core.codegen.CodeLibrary.enable_object_caching()",
        "core.codegen.JITCodeLibrary",
        "core.compiler.Compiler",
        "core.compiler.CompilerBase.define_pipelines()",
        "core.compiler.Flags.no_compile",
        "core.compiler_machinery.PassManager._finalized",
        "core.compiler_machinery.PassManager.finalize()",
        "core.compiler_machinery.PassManager.passes",
        "core.compiler_machinery.register_pass(mutates_CFG, analysis_only)",
        "core.funcdesc.FunctionDescriptor.lookup_module()",
        "core.ir.Assign",
        "core.lowering.Lower",
        "core.lowering.Lower._find_singly_assigned_variable()",
        "core.lowering.Lower._singly_assigned_vars",
        "core.lowering.Lower.delvar(name)",
        "core.lowering.Lower.func_ir",
        "core.typed_passes.BaseNativeLowering._name",
        "core.typed_passes.BaseNativeLowering.lowering_class",
        "core.typed_passes.BaseNativeLowering.run_pass(state)",
        "core.typed_passes.NativeLowering",
    ),
}
"""Paths in `numba`, for each thing that is built on them; in brackets the parameters that are passed, and
that the definitions here have in place of Numba's."""


def _sets(owner: object, name: str) -> bool:
    """Return whether a method of a class sets that attribute of its objects."""
    functions = (value for base in getattr(owner, "__mro__", ()) for value in vars(base).values())
    return any(
        one.opname == "STORE_ATTR" and one.argval == name
        for function in functions
        if isinstance(function, FunctionType) and name in function.__code__.co_names
        for one in dis.get_instructions(function)
    )


def _has(path: str) -> bool:
    """Return whether this version of Numba has a part, with the parameters that its path names."""
    name, takes, parameters = path.rstrip(")").partition("(")
    home, _, last = name.rpartition(".")
    try:
        owner = attrgetter(home)(numba)
    except AttributeError:
        return False
    if not hasattr(owner, last):
        return not takes and _sets(owner, last)
    if not takes:
        return True
    known = [one for one in inspect.signature(getattr(owner, last)).parameters.values() if one.name != "self"]
    passed = parameters.split(", ") if parameters else []
    more = [one for one in known[len(passed) :] if one.default is one.empty and one.kind < one.VAR_POSITIONAL]
    return [one.name for one in known[: len(passed)]] == passed and not more


def lacking(use: str) -> list[str]:
    """Return the parts that `NEEDS` lists for a use and that this version of Numba lacks."""
    return [f"numba.{path}" for path in NEEDS[use] if not _has(path)]


if _lacks := lacking("language"):
    raise ImportError(
        f"springgym cannot run with Numba {numba.__version__}, which has no {', '.join(_lacks)}: install a "
        "version of Numba that springgym asks for"
    )

# --- For the language -----------------------------------------------------------------------------------

cgutils = numba.core.cgutils
AbstractTemplate = numba.core.typing.templates.AbstractTemplate
infer = numba.core.typing.templates.infer
infer_global = numba.core.typing.templates.infer_global
signature = numba.core.typing.templates.signature
CPUDispatcher: Any = numba.core.registry.CPUDispatcher

PACKAGE = __name__.partition(".")[0]


class WholeTuple(models.TupleModel):
    """Passes a named tuple to functions as one value.

    Numba's own model unpacks it at every call, a hundred arrays into a thousand numbers, and the called
    function packs it again: this would be most of the code to compile.
    """

    def get_argument_type(self) -> ir.Type:
        return self.get_value_type()

    def as_argument(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return value

    def from_argument(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return value


@register_model(numba.types.NamedTuple)
def _tuple_model(manager: DataModelManager, kind: numba.types.NamedTuple) -> models.TupleModel:
    """Return the data model by which Numba stores a named tuple: `WholeTuple` for those of this package.

    Tuples of other packages keep Numba's model, which code compiled elsewhere expects.
    """
    own = kind.instance_class.__module__.partition(".")[0] == PACKAGE
    return WholeTuple(manager, kind) if own else models.TupleModel(manager, kind)


class Inner(CPUDispatcher):
    """A function that is compiled only for other compiled functions: Python cannot call it.

    See `pipelines`.
    """

    def __call__(self, *args: object, **kwargs: object) -> NoReturn:
        raise TypeError(
            f"{self.__name__} is compiled for use in kernels only; call {self.__name__}.py_func from Python"
        )

    def get_call_template(self, args: tuple[numba.types.Type, ...], kws: dict[str, numba.types.Type]) -> Any:
        """Return Numba's typing of a call, in which a literal number has the general type of its kind.

        To Numba, a counter that starts at 0 is the literal 0 until it has seen the rest of the loop. It would
        compile what takes the counter, and all that this calls, for the literal, and never use it. So, too,
        for a member of an enumeration, which is passed as the number that it is.
        """
        named = {name: _general(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(_general, args)), named)


def _general(kind: numba.types.Type) -> numba.types.Type:
    """Return the general type of a literal number, or of a member of an enumeration; or the type itself."""
    if isinstance(kind, numba.types.IntEnumMember):
        return kind.dtype
    return numba.types.unliteral(kind)


COLLECTED = 20_000
"""Number of new objects after which Python searches for reference cycles while a kernel is compiled."""


class CachedDispatcher(CPUDispatcher):
    """A compiled function that Python calls, whose code is cached."""

    def compile(self, sig: Asked) -> Callable[..., Any]:
        """Compile the kernel for a signature.

        Meanwhile Python searches less often for reference cycles, which would take a twentieth of the time.
        """
        usual = gc.get_threshold()
        gc.set_threshold(COLLECTED, *usual[1:])
        try:
            return super().compile(sig)
        finally:
            gc.set_threshold(*usual)
            if (stop := getattr(self._cache, "stop_waiting", None)) is not None:  # an unpickled one has none
                stop()


def definition(value: object) -> Callable[..., Any] | None:
    """Return the Python function that defines an intrinsic; None for any other object."""
    return getattr(value, "_defn", None)


# --- For the cache --------------------------------------------------------------------------------------

LOCK: Any = getattr(getattr(numba.core, "compiler_lock", None), "global_compiler_lock", None)

if hasattr(os, "register_at_fork") and LOCK is not None and not lacking("cache"):
    # A forked child inherits the compiler's lock, but not the thread that holds it, and would wait forever.
    # So a fork waits until no other thread compiles.
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)


def keep_in(dispatcher: Any, cache: object) -> None:
    """Let a compiled function look for its code in a cache, and put it there."""
    dispatcher._cache = cache
    dispatcher.__class__ = CachedDispatcher


def target_of(context: CPUContext) -> tuple[str, str, str]:
    """Return the processor that code is made for: its kind, its name and its features."""
    context.refresh()
    target: tuple[str, str, str] = context.codegen().magic_tuple()
    return target


def written_result(result: CompileResult) -> bytes:
    """Return a compiled function as bytes, without the bitcode (large, and only for inlining).

    Compiled callers find the machine code by its name. Numba's listing of the types of variables, the one
    string among the data, is left out, too: nothing reads it, and it contains the file's path.
    """
    (name, kind, (machine_code, _)), *others = result._reduce()
    kept = (name, kind, (machine_code, binding.parse_assembly("").as_bitcode()))
    parts = (kept, *("" if isinstance(one, str) else one for one in others))
    content: bytes = numba.core.serialize.dumps(parts)
    return content


def read_result(content: bytes, sig: Asked, context: CPUContext) -> CompileResult:
    """Return a compiled function from its bytes, with the requested argument types.

    Types of classes that a script defines differ from process to process. The names of the function's machine
    code are registered with Numba's engine, instead of the bitcode.
    """
    parts = pickle.loads(content)
    description = parts[1]
    names = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
    functions = [SimpleNamespace(name=name, is_declaration=False) for name in names]
    engine = context.codegen()._engine
    engine._load_defined_symbols(SimpleNamespace(functions=functions, global_variables=[]))
    found = numba.core.compiler.CompileResult._rebuild(context, *parts)
    args, _ = numba.core.sigutils.normalize_signature(sig)
    if found.signature.args == tuple(args):
        return found
    return found._replace(signature=found.signature.replace(args=tuple(args)))


# --- The pipelines --------------------------------------------------------------------------------------

NEEDLESS = (
    "DumpParforDiagnostics",
    "InlineInlinables",
    "LiteralPropagationSubPipelinePass",
    "NoPythonSupportedFeatureValidation",
    "NopythonRewrites",
    "RewriteDynamicRaises",
    "WithLifting",
)
"""Names of the passes of Numba's compiler that are left out. They handle what compiled functions here cannot
contain, such as array expressions (which allocate) or exceptions with messages made at run time."""


def pipelines() -> tuple[dict[str, object], dict[str, object]]:
    """Return the options of functions that are only ever inlined, and those of kernels.

    Inner functions get no wrappers for calls from Python, which are half of the cost of compiling. If this
    version of Numba allows it, they get no optimised code of their own either, which nothing would run; they
    are linked once, into their kernel, and keep less on the stack; and kernels are optimised once.
    """
    inner: dict[str, object] = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    if lacks := lacking("pipelines"):
        warnings.warn(
            f"Numba {numba.__version__} has no {', '.join(lacks)}: springgym compiles kernels as Numba "
            "usually does, which takes longer. Install a version of Numba that springgym asks for",
            RuntimeWarning,
            stacklevel=2,
        )
        return inner, {}
    from numba._dynfunc import make_function
    from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler
    from numba.core.compiler_machinery import register_pass
    from numba.core.ir import Assign
    from numba.core.lowering import Lower
    from numba.core.typed_passes import NativeLowering

    class InnerLibrary(JITCodeLibrary):
        """Library of a function's LLVM code, not optimised, which kernels link."""

        def _optimize_functions(self, ll_module: binding.ModuleRef) -> None:
            """Set the module's data layout, and optimise nothing: the kernel's library does that."""
            ll_module.data_layout = self._codegen._data_layout

        def finalize(self) -> None:
            """Finish without making machine code, and without linking the functions that this one calls."""
            self._finalized = True

        def _get_module_for_linking(self) -> binding.ModuleRef:
            """Return the code of the function and of all functions that it calls, directly or indirectly."""
            whole = self._alone().clone()
            for one in self._called():
                inner = isinstance(one, InnerLibrary)
                whole.link_in(one._alone() if inner else one._get_module_for_linking(), preserve=True)
            return whole

        def _alone(self) -> binding.ModuleRef:
            """Return the code of the function, linked so that several libraries may contain it."""
            for function in self._final_module.functions:
                if function.linkage == binding.Linkage.external and not function.is_declaration:
                    function.linkage = binding.Linkage.linkonce_odr
            return self._final_module

        def _called(self) -> list[JITCodeLibrary]:
            """Return the libraries of all functions that are called from this one, each once."""
            found: list[JITCodeLibrary] = []
            left = [*self._linking_libraries]
            while left:
                one = left.pop()
                if one not in found:
                    found.append(one)
                    if isinstance(one, InnerLibrary):
                        left.extend(one._linking_libraries)
            return found

    class KernelLibrary(JITCodeLibrary):
        """Library of a kernel's code, which is optimised once.

        Numba optimises twice, the first time to remove reference counts, which kernels do not have.
        """

        def _optimize_functions(self, ll_module: binding.ModuleRef) -> None:
            """Set the module's data layout, and optimise nothing: no function is inlined yet."""
            ll_module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            """Optimise the code of the kernel with that of all that it calls."""
            manager, builder = self._codegen._module_pass_manager()
            manager.run(self._final_module, builder)

    class ValueLower(Lower):
        """Keeps variables assigned once as LLVM values; Numba uses the stack if another block reads them."""

        def _find_singly_assigned_variable(self) -> None:
            super()._find_singly_assigned_variable()
            blocks = self.func_ir.blocks
            times = Counter(one.target.name for block in blocks.values() for one in block.find_insts(Assign))
            above = compute_cfg_from_blocks(blocks).dominators()
            flow = compute_use_defs(blocks)
            home = {name: label for label, names in flow.defmap.items() for name in names}
            strays = {
                name
                for label, names in flow.usemap.items()
                for name in names
                if not (home.get(name) in above[label] and home[name] < label)
            }
            once = {name for name, count in times.items() if count == 1 and name in home}
            self._singly_assigned_vars |= once - strays - must_use_alloca(blocks)

        def delvar(self, name: str) -> None:
            """Do nothing: without reference counts, nothing has to be released."""

    @register_pass(mutates_CFG=True, analysis_only=False)
    class InnerLowering(NativeLowering):
        """Compiler pass that lowers a function to LLVM code without making machine code."""

        _name = "inner_lowering"
        lowering_class = ValueLower

        def run_pass(self, state: StateDict) -> bool:
            context = state.targetctx
            function = state.func_id
            state.library = InnerLibrary(context.codegen(), function.func_qualname)
            state.flags.no_compile = True
            super().run_pass(state)
            lowered = state.cr
            # Numba identifies functions by their Python entry points: make one, which is never called.
            name = (lowered.fndesc.lookup_module(), function.func_name, "", 0, lowered.env)
            entry = make_function(*name, (state.library,))
            context.insert_user_function(entry, lowered.fndesc, [state.library])
            state.cr = lowered._replace(cfunc=entry)
            return True

    @register_pass(mutates_CFG=True, analysis_only=False)
    class KernelLowering(NativeLowering):
        """Compiler pass that lowers a kernel to LLVM code in a `KernelLibrary`."""

        _name = "kernel_lowering"

        def run_pass(self, state: StateDict) -> bool:
            state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return super().run_pass(state)

    class KernelCompiler(Compiler):
        """Numba's compiler with ``lowering`` for `NativeLowering`, and without the passes `NEEDLESS`."""

        lowering = KernelLowering

        def define_pipelines(self) -> list[PassManager]:
            (passes,) = super().define_pipelines()
            passes.passes[:] = [
                (self.lowering if one is NativeLowering else one, why)
                for one, why in passes.passes
                if one.__name__ not in NEEDLESS
            ]
            passes._finalized = False
            passes.finalize()
            return [passes]

    class InnerCompiler(KernelCompiler):
        lowering = InnerLowering

    return {**inner, "pipeline_class": InnerCompiler}, {"pipeline_class": KernelCompiler}
