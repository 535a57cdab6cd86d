"""Compilation: the two decorators every compiled function carries, and their disk cache.

``@kernel`` marks functions that Python calls: they release the GIL and are cached on disk. ``@compiled``
marks functions that only kernels call; their code is part of the kernels that use them.

Numba's own cache checks only the file of the cached function, so after an edit in a file that it *calls* the
old physics would silently run, and two processes that compile at once can corrupt its index. Here a cache
entry is one file, named by a hash over everything it depends on: the code of all functions the kernel is
compiled from with the constants that they name (`springgym.core.compiler.code_digest`), the argument types,
the CPU, the versions of Python, NumPy and Numba, and those of Numba's settings that change the code. Nothing
is ever invalidated or locked: other code has another name. A function without a digest is compiled by each
process. Entries are executed, so their folder must belong to the user or to somebody trusted. Folders can be
copied, shared and read-only. Code is made for the processor that compiles it, and found by similar ones; with
``SPRINGGYM_CPU=x86-64-v3`` (or another of `LEVELS`) it is made for every processor of that level, and found
by processes with the same setting. No other setting of Numba is changed.

If ``SPRINGGYM_CPU`` is not set, entries that the folder lacks are taken from the package `KERNELS`, if it is
installed and fits. It has code for the levels; each processor runs that of its own (`fitting_level`). All
levels give bit-identical results. Such code can run in a process whose Numba compiles for the processor
itself: the target is fixed when code is made, and functions of both kinds pass numbers in the same registers.

The cache needs a few private parts of Numba, listed in `INSIDE`. If a version of Numba lacks one, a warning
is issued and every process compiles again; results are the same.

With ``NUMBA_BOUNDSCHECK=1`` in the environment all compiled functions check every index, those of `lanes` and
`blocks` too, and raise an `IndexError`: slow, for debugging. Set ``NUMBA_OPT=1`` as well: where bodies
collide, LLVM takes many minutes to optimise all these checks, but a minute at this level.

With ``NUMBA_DISABLE_JIT=1`` in the environment this module cannot be imported: lanes exist in compiled code
alone.
"""

from __future__ import annotations

import gc
import hashlib
import importlib.util
import itertools
import json
import logging
import os
import pickle
import sys
import sysconfig
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeGuard
from uuid import uuid4

import numba
import numpy as np
from llvmlite import binding, ir
from numba.core import sigutils
from numba.core.registry import CPUDispatcher
from numba.extending import is_jitted, models, register_model

from springgym.core.compiler.code_digest import NotHashable, digest
from springgym.version import __version__

if TYPE_CHECKING:
    from numba.core.codegen import JITCPUCodegen
    from numba.core.compiler import CompileResult, StateDict
    from numba.core.compiler_machinery import PassManager
    from numba.core.cpu import CPUContext
    from numba.core.datamodel import DataModelManager
    from numba.core.funcdesc import FunctionDescriptor
    from numba.core.typing.templates import Signature

    Asked: TypeAlias = Signature | tuple[numba.types.Type, ...]
    """Argument types for which Numba requests code."""

if numba.config.DISABLE_JIT:
    raise ImportError("springgym runs compiled code only: unset NUMBA_DISABLE_JIT")

PACKAGE = __name__.partition(".")[0]
LOGGER = logging.getLogger(PACKAGE)

V3 = "cx16 popcnt sahf sse3 sse4.1 sse4.2 ssse3 avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave"
V4 = f"{V3} avx512f avx512bw avx512cd avx512dq avx512vl"
INTELS = "skylake-avx512"
"""Level of Intel's processors with AVX-512: its code estimates 1/√d, see `springgym.core.language.lanes`."""

LEVELS = {
    "x86-64-v3": V3.split(),
    "x86-64-v4": V4.split(),
    INTELS: f"{V4} adx aes clflushopt clwb pclmul prfchw rdrnd rdseed xsavec xsaveopt".split(),
}
"""Levels of processors that code can be made for, instead of the compiling one, with the features of each
(x86-64 psABI, table 3.1; Intel's level: LLVM's features for user programs). Names are LLVM's. Levels below
these lack fused multiply-add."""


def fitting_level(name: str, has: Mapping[str, bool]) -> str | None:
    """Return the level whose code is fastest on a processor; None if it supports no level.

    Parameters
    ----------
    name
        LLVM's name of the processor, such as "znver4".
    has
        Its features.
    """
    fits = [level for level, needs in LEVELS.items() if all(map(has.get, needs))]
    if name.startswith("znver"):  # where estimates gain nothing
        fits = [level for level in fits if level != INTELS]
    return fits[-1] if fits else None


def _level(asked: str, has: Mapping[str, bool]) -> str | None:
    """Return the level to compile for; None for this processor itself, whose features are ``has``.

    Raises
    ------
    ValueError
        If there is no such level.
    """
    if asked in ("", "host"):
        return None
    if asked not in LEVELS:
        raise ValueError(f"SPRINGGYM_CPU is {asked!r}; it must be host, {', '.join(LEVELS)}")
    lacks = [name for name in LEVELS[asked] if not has.get(name)]
    if lacks:
        warnings.warn(
            f"SPRINGGYM_CPU is {asked!r}, and this processor has no {', '.join(lacks)}: code is compiled for "
            "this processor, and compiled code for others is not used",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES is not None:
        raise ValueError("SPRINGGYM_CPU is set, and so is NUMBA_CPU_NAME or NUMBA_CPU_FEATURES: unset one")
    return asked


def features() -> Mapping[str, bool]:
    """Return the features of this processor, by LLVM's names."""
    try:
        return dict(binding.get_host_cpu_features())
    except RuntimeError:  # LLVM does not know, on some processors other than x86-64
        return {}


LEVEL = _level(os.environ.get("SPRINGGYM_CPU", ""), features())
"""The level of `LEVELS` that code is made for; None for processors like this one."""

if LEVEL is not None:  # before Numba compiles anything; the key of an entry holds both
    numba.config.CPU_NAME = LEVEL
    numba.config.CPU_FEATURES = ""

_FITS = LEVEL or fitting_level(binding.get_host_cpu_name(), features())

REGISTER = 64 if _FITS is not None and "avx512f" in LEVELS[_FITS] else 32
"""Size of a vector register of the target processors [bytes]."""

OPTIONS = {"error_model": "numpy", "_nrt": False}
"""IEEE arithmetic (no fastmath); no allocation, hence no reference counts of arrays, which would cost as much
as the physics where small functions pass arrays."""

SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")
"""Settings of `numba.config` that change the compiled code."""

VERSIONS = {
    "Python": str(sysconfig.get_config_var("EXT_SUFFIX")).split(".")[1],  # as for modules written in C
    "NumPy": np.__version__,
    "Numba": numba.__version__,
}
"""Versions that compiled code depends on, besides the processor."""

SAMPLE = CPUDispatcher(lambda: None)
"""A function that is never called: an example of this version's wrapper of compiled functions."""


def _inside(path: str) -> Any:
    """Return a private object of Numba, by its dotted path; None if this version lacks it."""
    try:
        return attrgetter(path)(numba)
    except AttributeError:
        return None


INSIDE = {
    path: _inside(path)
    for path in (
        "core.compiler_lock.global_compiler_lock",
        "core.compiler.CompileResult._reduce",
        "core.compiler.CompileResult._rebuild",
        "core.serialize.dumps",
        "core.codegen.JitEngine._load_defined_symbols",
    )
}
"""The private parts of Numba that the cache uses; None for those that this version lacks."""

LOCK, REDUCE, REBUILD, DUMPS, NAME_SYMBOLS = INSIDE.values()

LACKING = [f"numba.{path}" for path, found in INSIDE.items() if found is None]
if not hasattr(SAMPLE, "_cache"):
    LACKING.append(f"{type(SAMPLE).__name__}._cache")


def _warn_uncached(why: str) -> None:
    """Warn, once per process, that compiled code is not cached."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(
            f"Numba {numba.__version__} {why}: springgym cannot keep compiled code, and each process "
            "compiles anew, for up to a minute. Install a version of Numba that springgym asks for",
            RuntimeWarning,
            stacklevel=3,
        )


_warned = False
if LACKING:
    _warn_uncached(f"has no {', '.join(LACKING)}")

if LOCK is not None and hasattr(os, "register_at_fork"):
    # A forked child inherits the compiler's lock, but not the thread that holds it, and would wait forever.
    # So a fork waits until no other thread compiles.
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)


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


CHECKED = bool(numba.config.BOUNDSCHECK)
"""Whether compiled functions check indices, and `SameTypes` checks argument types."""


class Inner(type(SAMPLE)):  # type: ignore[misc]
    """A function that is compiled only for other compiled functions: Python cannot call it.

    See `_pipelines`.
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


class CachedDispatcher(type(SAMPLE)):  # type: ignore[misc]
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
            if isinstance(self._cache, DigestKeyedCache):  # an unpickled one has none
                self._cache.stop_waiting()


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


def _pipelines() -> tuple[dict[str, object], dict[str, object]]:
    """Return the options of functions that are only ever inlined, and those of kernels.

    Inner functions get no wrappers for calls from Python, which are half of the cost of compiling. If this
    version of Numba allows it, they get no optimised code of their own either, which nothing would run; they
    are linked once, into their kernel, and keep less on the stack; and kernels are optimised once.
    """
    inner: dict[str, object] = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    try:
        from numba._dynfunc import make_function
        from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import Compiler
        from numba.core.compiler_machinery import register_pass
        from numba.core.ir import Assign
        from numba.core.lowering import Lower
        from numba.core.typed_passes import NativeLowering
    except ImportError:
        return inner, {}

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


INNER, OUTER = _pipelines()


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call, inlined at each call; it returns numbers, not arrays.
    Passing a scene's sixty arrays by value costs a single copy up to a third of its step, and compiling such
    functions separately takes as long as inlining them.
    """
    dispatcher = numba.njit(**OPTIONS, **INNER)(function)
    dispatcher.__class__ = Inner
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls: releases the GIL, cached on disk by a digest of its code."""
    dispatcher = numba.njit(**OPTIONS, **OUTER, nogil=True, no_cfunc_wrapper=True)(function)
    if not LACKING:
        dispatcher._cache = DigestKeyedCache(function)
        dispatcher.__class__ = CachedDispatcher
    return dispatcher


def is_inner(function: object) -> TypeGuard[Any]:
    """Return whether a function is one of `compiled`."""
    return isinstance(function, Inner)


_TYPES: dict[tuple[object, ...], tuple[numba.types.Type, object]] = {}
"""Numba's types of arrays and tuples, by keys that determine them. Each entry also holds the types whose ids
are in its key: while they live, no other type has these ids."""


def type_of(value: object) -> numba.types.Type:
    """Return Numba's type of a value.

    Types of arrays and tuples are cached: finding those of all arrays of a simulator takes longer than making
    the arrays.
    """
    parts: list[numba.types.Type] = []
    if type(value) is np.ndarray:
        flags = value.flags
        dtype = value.dtype
        layout = (value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable)
        key: tuple[object, ...] = (dtype, dtype.isalignedstruct, *layout)
    elif isinstance(value, tuple):
        parts = [type_of(part) for part in value]
        key = (type(value), *map(id, parts))
    else:
        return numba.typeof(value)
    if key not in _TYPES:
        _TYPES[key] = numba.typeof(value), parts
    return _TYPES[key][0]


class SameTypes:
    """A function that is always called with arguments of the types of the first call.

    The types of a kernel's arguments are determined once. Numba determines them at every call, which for a
    simulator's sixty arrays takes five times as long as the call itself. Later calls are not checked:
    arguments of other types are read as if they had the first types. So callers make all arrays themselves,
    and convert other arguments, such as counts to int and flags to bool. If Numba checks bounds
    (``NUMBA_BOUNDSCHECK=1``), the types of every call are compared, and a difference raises a TypeError.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function: Any = function
        self._code: Callable[..., Any] | None = None
        self._types: tuple[numba.types.Type, ...] | None = None

    def __call__(self, *arguments: object) -> object:
        if self._code is None:
            self._code = self._function
            if is_jitted(self._function):
                self._types = types = tuple(map(type_of, arguments))
                if types not in self._function.overloads:  # compiling waits for the compiler's lock
                    self._function.compile(types)
                self._code = self._function.get_overload(types)
        elif CHECKED and self._types and self._types != (types := tuple(map(numba.typeof, arguments))):
            name = self._function.__name__
            raise TypeError(f"{name} was compiled for {self._types} and is called with {types}")
        return self._code(*arguments)


def cache_directory() -> Path | None:
    """Return the folder of compiled code: ``$SPRINGGYM_CACHE_DIR``, else the user's cache folder, or None.

    Variables of the system count only if they hold an absolute path: entries are executed, so they are not
    read from wherever Python was started. None: the user has no home folder.
    """
    if chosen := os.environ.get("SPRINGGYM_CACHE_DIR"):
        return Path(chosen).absolute()
    if sys.platform == "win32":
        named = os.environ.get("LOCALAPPDATA", "")
        usual = "~/AppData/Local"
    elif sys.platform == "darwin":
        named = ""
        usual = "~/Library/Caches"
    else:
        named = os.environ.get("XDG_CACHE_HOME", "")
        usual = "~/.cache"
    if os.path.isabs(named):
        return Path(named) / PACKAGE
    try:
        home = Path(usual).expanduser()
    except RuntimeError:  # a user without a home, as in some containers
        return None
    return home / PACKAGE if home.is_absolute() else None


def _asked(found: CompileResult, sig: Asked) -> CompileResult:
    """Return a cached result with the requested argument types. Types of classes that a script defines differ
    from process to process."""
    args, _ = sigutils.normalize_signature(sig)
    if found.signature.args == tuple(args):
        return found
    return found._replace(signature=found.signature.replace(args=tuple(args)))


def _machine_code(parts: tuple[Any, ...]) -> tuple[object, ...]:
    """Return the data that Numba saves for a function, without the bitcode (large, and only for inlining).

    Compiled callers find the machine code by its name. Numba's listing of the types of variables, the one
    string among the data, is left out, too: nothing reads it, and it contains the file's path.
    """
    (name, kind, (machine_code, _)), *others = parts
    kept = (name, kind, (machine_code, binding.parse_assembly("").as_bitcode()))
    return kept, *("" if isinstance(one, str) else one for one in others)


def _name_symbols(codegen: JITCPUCodegen, description: FunctionDescriptor) -> None:
    """Register the names of a function's machine code with Numba's engine, instead of the bitcode."""
    names = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
    functions = [SimpleNamespace(name=name, is_declaration=False) for name in names]
    NAME_SYMBOLS(codegen._engine, SimpleNamespace(functions=functions, global_variables=[]))


KERNELS = "springgym_kernels"
"""Package of compiled code, made by ``tools/kernels.py`` of a clone: a folder of entries, and `MADE`."""

MADE = "made.json"
"""File in it: ``{"versions": {…}, "levels": […]}``, of what its code is made for; see `made_here`."""


def made_here() -> dict[str, str]:
    """Return the versions that the code of `KERNELS` must have been made for to run in this process."""
    return {PACKAGE: __version__, **VERSIONS}


@cache
def shipped() -> tuple[Path, str] | None:
    """Return the folder of `KERNELS` and the level whose code is for this process.

    None if the package is not installed, if ``SPRINGGYM_CPU`` or Numba's settings set the target, or if the
    package does not fit (then a warning gives the reason).
    """
    if os.environ.get("SPRINGGYM_CPU") or numba.config.CPU_NAME or numba.config.CPU_FEATURES is not None:
        return None
    try:
        spec = importlib.util.find_spec(KERNELS)
    except ValueError:  # a module of this name has no spec
        spec = None
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)))
    level = fitting_level(binding.get_host_cpu_name(), features())
    try:
        made = json.loads((folder / MADE).read_text(encoding="utf-8"))
        versions = dict(made["versions"])
        levels = list(map(str, made["levels"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        why = f"it is damaged ({type(error).__name__}: {error})"
    else:
        unfit = [
            f"it is for {name} {versions.get(name)}, and this is {here}"
            for name, here in made_here().items()
            if versions.get(name) != here
        ]
        if level in levels and not unfit:
            return folder, level
        ours = f"one of {level}" if level else "none of these"
        why = unfit[0] if unfit else f"it is for processors of {', '.join(levels)}, and this is {ours}"
    LOGGER.warning("springgym: the compiled code of springgym-kernels is not used: %s", why)
    return None


PATIENCE = 2.0
"""Compilation that takes longer than this is reported to the user [s]."""

_TOLD = threading.Lock()
"""Held once compilation was reported."""

_KERNELS = itertools.count(1)
"""Counts the kernels that this process compiles."""


def _report_compiling(over: threading.Event, kernel: int) -> None:
    """Report that a kernel is being compiled, until it is ``over``.

    On a terminal, a line counts the seconds, and is then erased. Elsewhere, or if logging is configured, a
    line is logged once per process.
    """
    logs = LOGGER.hasHandlers() or not LOGGER.isEnabledFor(logging.WARNING)
    if logs or sys.stderr is None or not sys.stderr.isatty():
        if _TOLD.acquire(blocking=False):
            LOGGER.warning(
                "springgym: compiling, up to a minute, once per kind of scene; see `springgym compile`"
            )
        return
    began = time.perf_counter() - PATIENCE
    while not over.wait(1.0):
        seconds = time.perf_counter() - began
        sys.stderr.write(f"\rspringgym: compiling kernel {kernel} (once, up to a minute): {seconds:.0f} s")
        sys.stderr.flush()
    sys.stderr.write("\r\033[K")


class DigestKeyedCache:
    """Numba's cache interface with one file per entry, named by a hash of all that it depends on."""

    cache_path = None
    """for Numba's statistics"""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._waiting: threading.Timer | None = None

    def flush(self) -> None:
        """Do nothing: no entry is ever out of date."""

    def load_overload(self, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        """Return the compiled function of a signature, if there is an entry of it."""
        found = self._load(sig, target_context)
        if found is None:
            LOGGER.info("compile %s.%s", self._function.__module__, self._function.__qualname__)
            self._waiting = threading.Timer(PATIENCE, _report_compiling)
            self._waiting.args = (self._waiting.finished, next(_KERNELS))
            self._waiting.daemon = True
            self._waiting.start()
        return found

    def stop_waiting(self) -> None:
        """Stop reporting that a kernel is being compiled."""
        waiting = self._waiting
        self._waiting = None
        if waiting is not None:
            waiting.cancel()
            waiting.join()  # so that no thread runs if the process forks next

    def _load(self, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        try:
            target_context.refresh()
            for path in self._places(sig, target_context.codegen()):
                if (found := self._read(path, sig, target_context)) is not None:
                    return found
        except Exception:  # Numba's internals have changed
            pass
        return None

    def _read(self, path: Path, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        """Return the content of an entry; None if there is none, or if anything is wrong with it."""
        try:
            content = path.read_bytes()
            payload = content[DIGEST:]
            if content[:DIGEST] != _checksum(path, payload):
                return None
            parts = pickle.loads(payload)
            _name_symbols(target_context.codegen(), parts[1])
            return _asked(REBUILD(target_context, *parts), sig)
        except Exception:  # the function is compiled again, and the entry replaced
            return None

    def save_overload(self, sig: Asked, data: CompileResult) -> None:
        """Save a compiled function."""
        try:
            folder = cache_directory()
            code = self._digest(sig)
            if folder is None:
                _warn_unsaved("this user has no home folder")
            if folder is None or code is None:
                return
            path = folder / self._name(code, data.codegen.magic_tuple())
            payload = DUMPS(_machine_code(REDUCE(data)))
        except (AttributeError, TypeError, ValueError) as error:  # Numba's internals have changed
            _warn_uncached(f"cannot be asked for its compiled code ({error})")
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{uuid4().hex}.tmp")
            try:
                with temporary.open("xb") as file:  # permissions follow the umask
                    file.write(_checksum(path, payload) + payload)
                os.replace(temporary, path)  # readers see a complete entry or none
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        except OSError as error:  # as of a full disk, costs a compilation, not the program
            _warn_unsaved(f"{error.strerror or error}: {folder}")

    def _places(self, sig: Asked, codegen: JITCPUCodegen) -> Iterator[Path]:
        """Yield the files that may hold the code: in the cache folder, then in `KERNELS`."""
        code = self._digest(sig)
        if code is None:
            return
        target = codegen.magic_tuple()
        folder = cache_directory()
        if folder is not None:
            yield folder / self._name(code, target)
        if (found := shipped()) is not None:
            folder, level = found
            yield folder / self._name(code, (target[0], level, ""))

    def _digest(self, sig: Asked) -> bytes | None:
        """Return the digest of what the function is compiled from; None if it has none."""
        try:
            return digest(self._function, getattr(sig, "args", sig), (__name__,))
        except NotHashable as error:
            LOGGER.debug("%s is not kept: %s", self._function.__qualname__, error)
            return None

    def _name(self, code: bytes, target: tuple[str, str, str]) -> str:
        """Return the file name of an entry; ``target`` is the processor of its code, in Numba's form."""
        settings = [str(getattr(numba.config, name, None)) for name in SETTINGS]
        key = hashlib.sha256(repr((VERSIONS, target, settings)).encode() + code).hexdigest()
        return f"{self._function.__module__}.{self._function.__name__}-{key}.nbc"


_UNSAVED = threading.Lock()
"""Held once it was reported that code is not kept."""


def _warn_unsaved(why: str) -> None:
    """Log, once per process, that compiled code is not kept."""
    if _UNSAVED.acquire(blocking=False):
        LOGGER.warning(
            "springgym: compiled code is not kept, so that every start compiles again (%s); set "
            "SPRINGGYM_CACHE_DIR to a folder that can be written",
            why,
        )


DIGEST = hashlib.sha256().digest_size
"""Length of the checksum that an entry begins with [bytes]."""


def _checksum(path: Path, payload: bytes) -> bytes:
    """Return a hash of an entry's content and name, so that a renamed entry is not accepted."""
    return hashlib.sha256(path.name.encode() + payload).digest()
