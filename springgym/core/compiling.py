"""Compilation: the two decorators every compiled function carries, and their disk cache.

``@kernel`` marks what Python calls: it releases the GIL and is cached on disk. ``@compiled`` marks what
only kernels call; it is stored inside the kernels that use it.

Numba's own cache looks at the file of the cached function alone, so an edit in a file it *calls* would
silently run the old physics, and its index can be torn by two processes that compile at once. Here a
cache entry is one file, named by a hash over everything it depends on: the code of all functions the kernel
is compiled from with the constants that they name (`springgym.core.code_digest`), the argument types, the
CPU, the versions of Python, NumPy and Numba, and those of Numba's settings that change the code. Nothing is
ever invalidated or locked; other code, another name. What has no digest is compiled anew by each process.
An entry is run: its folder must be one's own, or of somebody whom one trusts. Folders can be copied, shared
and read only. Code is made for the processor that makes it, and found by those like it; with
``SPRINGGYM_CPU=x86-64-v3`` (or another of `LEVELS`), for every processor of that level, and found by
processes that are told the same. Numba's settings are not touched but for that one.

What the folder lacks, processes that are not told ``SPRINGGYM_CPU`` take from the package `KERNELS`, if it is
installed and fits: code for the levels, of which each processor runs that of its own (`fitting_level`). All
levels compute the same bits. Such code runs in a process whose Numba compiles for the processor itself: code
is told what to run on when it is made, and functions of both kinds hand numbers on in the same registers.

The cache needs a few things of Numba that are not of its public interface: `INSIDE` names them. Where a
version of Numba lacks one, a warning says so, every process compiles anew, and results are the same.

With ``NUMBA_BOUNDSCHECK=1`` in the environment all compiled functions check every index, those of `lanes` and
`blocks` too, and raise an `IndexError`: slow, for the search of a fault. Set ``NUMBA_OPT=1`` as well: to
optimise all these checks where bodies collide takes LLVM many minutes, to leave most of that a minute.

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

from springgym import __version__
from springgym.core.code_digest import NotHashable, digest

if TYPE_CHECKING:
    from numba.core.codegen import JITCPUCodegen
    from numba.core.compiler import CompileResult, StateDict
    from numba.core.compiler_machinery import PassManager
    from numba.core.cpu import CPUContext
    from numba.core.datamodel import DataModelManager
    from numba.core.funcdesc import FunctionDescriptor
    from numba.core.typing.templates import Signature

    Asked: TypeAlias = Signature | tuple[numba.types.Type, ...]
    """Types of the arguments that Numba asks code for."""

if numba.config.DISABLE_JIT:
    raise ImportError("springgym runs compiled code only: unset NUMBA_DISABLE_JIT")

PACKAGE = __name__.partition(".")[0]
LOGGER = logging.getLogger(PACKAGE)

V3 = "cx16 popcnt sahf sse3 sse4.1 sse4.2 ssse3 avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave"
V4 = f"{V3} avx512f avx512bw avx512cd avx512dq avx512vl"
INTELS = "skylake-avx512"
"""Level of Intel's processors with AVX-512: its code estimates 1/√d, see `springgym.core.lanes`."""

LEVELS = {
    "x86-64-v3": V3.split(),
    "x86-64-v4": V4.split(),
    INTELS: f"{V4} adx aes clflushopt clwb pclmul prfchw rdrnd rdseed xsavec xsaveopt".split(),
}
"""Processors that code can be made for, other than the one that makes it, and what each of them has
(x86-64 psABI, table 3.1; Intel's, for user programs, by LLVM). Names are LLVM's. Those below do not have the
fused product and sum."""


def fitting_level(name: str, has: Mapping[str, bool]) -> str | None:
    """Return the level whose code is the fastest on a processor; None if it has no level.

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
    """Return the level to make code for; None for this processor itself, which ``has`` some features.

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
"""The processors that code is made for, of `LEVELS`; None for those like this one."""

if LEVEL is not None:  # before Numba compiles anything; the key of an entry holds both
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = LEVEL, ""

_FITS = LEVEL or fitting_level(binding.get_host_cpu_name(), features())

REGISTER = 64 if _FITS is not None and "avx512f" in LEVELS[_FITS] else 32
"""Size of a vector register of the processors that code is made for [bytes]."""

OPTIONS = {"error_model": "numpy", "_nrt": False}
"""IEEE arithmetic (no fastmath); no allocation, hence no counting of references to arrays, which cost as
much as the physics where small functions hand arrays on."""

SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")
"""Those of `numba.config` that change what is compiled."""

VERSIONS = {
    "Python": str(sysconfig.get_config_var("EXT_SUFFIX")).split(".")[1],  # as for modules written in C
    "NumPy": np.__version__,
    "Numba": numba.__version__,
}
"""What compiled code fits, beside a processor."""

SAMPLE = CPUDispatcher(lambda: None)
"""A function that is never called: a sample of how this version of Numba wraps a compiled function."""


def _inside(path: str) -> Any:
    """Something in Numba that may be gone in its next version; None if it is."""
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
"""The private things in Numba that the cache is made of; None for what this version lacks."""

LOCK, REDUCE, REBUILD, DUMPS, NAME_SYMBOLS = INSIDE.values()

LACKING = [f"numba.{path}" for path, found in INSIDE.items() if found is None]
if not hasattr(SAMPLE, "_cache"):
    LACKING.append(f"{type(SAMPLE).__name__}._cache")


def _warn_uncached(why: str) -> None:
    """Warn, once a process, that compiled code is not kept."""
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
    # A forked child has the compiler's lock as it was, but not the thread that held it: it would wait for
    # ever. So a fork waits until no other thread compiles.
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)


class WholeTuple(models.TupleModel):
    """Hands a named tuple on as one value.

    Numba's own model takes it apart at every call, a hundred arrays into a thousand numbers, and the function
    that is called puts them together again: most of what there would be to compile.
    """

    def get_argument_type(self) -> ir.Type:
        return self.get_value_type()

    def as_argument(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return value

    def from_argument(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return value


@register_model(numba.types.NamedTuple)
def _tuple_model(manager: DataModelManager, kind: numba.types.NamedTuple) -> models.TupleModel:
    """Return the data model of this package's own tuples.

    Those of others stay as they are, for code that others have compiled.
    """
    own = kind.instance_class.__module__.partition(".")[0] == PACKAGE
    return WholeTuple(manager, kind) if own else models.TupleModel(manager, kind)


CHECKED = bool(numba.config.BOUNDSCHECK)
"""True where compiled functions check indices, and `SameTypes` types."""


class Inner(type(SAMPLE)):  # type: ignore[misc]
    """An `Inner` function is compiled for other compiled functions alone: Python cannot call it.

    See `_pipelines`.
    """

    def __call__(self, *args: object, **kwargs: object) -> NoReturn:
        raise TypeError(
            f"{self.__name__} is compiled for use in kernels only; call {self.__name__}.py_func from Python"
        )

    def get_call_template(self, args: tuple[numba.types.Type, ...], kws: dict[str, numba.types.Type]) -> Any:
        """Return how Numba types a call: a number that is written out counts as any number of its kind.

        A count that begins with 0 is the number 0 to Numba until it has seen the rest of the loop. It would
        compile what takes the count, and all that this calls, for 0 alone, and use none of it.
        """
        named = {name: numba.types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(numba.types.unliteral, args)), named)


COLLECTED = 20_000
"""Number of new objects after which Python searches for reference cycles while a kernel is compiled."""


class Kept(type(SAMPLE)):  # type: ignore[misc]
    """A compiled function that Python calls, whose code is kept."""

    def compile(self, sig: Asked) -> Callable[..., Any]:
        """Compile the kernel for a signature.

        Meanwhile Python searches for reference cycles less often: that takes a twentieth of the time.
        """
        usual = gc.get_threshold()
        gc.set_threshold(COLLECTED, *usual[1:])
        try:
            return super().compile(sig)
        finally:
            gc.set_threshold(*usual)
            if isinstance(self._cache, DigestKeyedCache):  # one that was unpickled has none
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
"""Names of the passes of Numba's compiler that are left out. They handle what compiled functions cannot have,
such as expressions of whole arrays (these would be allocated) or messages made as they are raised."""


def _pipelines() -> tuple[dict[str, object], dict[str, object]]:
    """Return the options of functions that are only ever inlined, and those of kernels.

    No code is made by which Python would call inner functions: that is half of what compiling costs. If this
    version of Numba lets us, no optimised code is made of them either, which nobody would run; they are
    linked once, into their kernel, and keep less on the stack; and kernels are optimised once.
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
        """An `InnerLibrary` holds LLVM's code of a function, not optimised, for kernels to link."""

        def _optimize_functions(self, ll_module: binding.ModuleRef) -> None:
            """Set the module's data layout, and optimise nothing: the kernel's library does that."""
            ll_module.data_layout = self._codegen._data_layout

        def finalize(self) -> None:
            """End without machine code, and without the code of what the function calls."""
            self._finalized = True

        def _get_module_for_linking(self) -> binding.ModuleRef:
            """Return the code of the function and of all that it calls, directly or through others."""
            whole = self._alone().clone()
            for one in self._called():
                inner = isinstance(one, InnerLibrary)
                whole.link_in(one._alone() if inner else one._get_module_for_linking(), preserve=True)
            return whole

        def _alone(self) -> binding.ModuleRef:
            """Return the code of the function, of which several libraries may have a copy."""
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
        """A `KernelLibrary` holds the code of a kernel, and optimises it once.

        Numba does so twice, the first time to find references that need not be counted: kernels count none.
        """

        def _optimize_functions(self, ll_module: binding.ModuleRef) -> None:
            """Set the module's data layout, and optimise nothing: no function is inlined yet."""
            ll_module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            """Optimise the code of the kernel with that of all that it calls."""
            manager, builder = self._codegen._module_pass_manager()
            manager.run(self._final_module, builder)

    class ValueLower(Lower):
        """Keeps what is assigned once as a value; Numba writes it to the stack if another block reads it."""

        def _find_singly_assigned_variable(self) -> None:
            super()._find_singly_assigned_variable()
            blocks = self.func_ir.blocks
            times = Counter(one.target.name for block in blocks.values() for one in block.find_insts(Assign))
            above, flow = compute_cfg_from_blocks(blocks).dominators(), compute_use_defs(blocks)
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
            """Nothing is counted, so that nothing has to be let go."""

    @register_pass(mutates_CFG=True, analysis_only=False)
    class InnerLowering(NativeLowering):
        """This compiler pass lowers a function to LLVM's code, and makes no machine code of it."""

        _name = "inner_lowering"
        lowering_class = ValueLower

        def run_pass(self, state: StateDict) -> bool:
            context, function = state.targetctx, state.func_id
            state.library = InnerLibrary(context.codegen(), function.func_qualname)
            state.flags.no_compile = True
            super().run_pass(state)
            lowered = state.cr
            # Numba tells functions apart by what Python would call: one of this name, which nobody calls.
            name = (lowered.fndesc.lookup_module(), function.func_name, "", 0, lowered.env)
            entry = make_function(*name, (state.library,))
            context.insert_user_function(entry, lowered.fndesc, [state.library])
            state.cr = lowered._replace(cfunc=entry)
            return True

    @register_pass(mutates_CFG=True, analysis_only=False)
    class KernelLowering(NativeLowering):
        """This compiler pass lowers a kernel to LLVM's code, in a `KernelLibrary`."""

        _name = "kernel_lowering"

        def run_pass(self, state: StateDict) -> bool:
            state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return super().run_pass(state)

    class KernelCompiler(Compiler):
        """Numba's compiler, which ends with another pass than `NativeLowering`."""

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
    """Compile a function that only kernels call, into each place it is called from; it returns numbers, not
    arrays. Handing a scene's sixty arrays on by value costs one copy up to a third of its step, and compiling
    such functions one by one as much as inlining them.
    """
    dispatcher = numba.njit(**OPTIONS, **INNER)(function)
    dispatcher.__class__ = Inner
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls: releases the GIL, cached on disk by a digest of its code."""
    dispatcher = numba.njit(**OPTIONS, **OUTER, nogil=True, no_cfunc_wrapper=True)(function)
    if not LACKING:
        dispatcher._cache = DigestKeyedCache(function)
        dispatcher.__class__ = Kept
    return dispatcher


def is_inner(function: object) -> TypeGuard[Any]:
    """Return whether a function is one of `compiled`."""
    return isinstance(function, Inner)


_TYPES: dict[tuple[object, ...], tuple[numba.types.Type, object]] = {}
"""Numba's types of arrays and tuples, by keys that determine them. Each entry also holds the types whose ids
are in its key: while they live, no other type has these ids."""


def type_of(value: object) -> numba.types.Type:
    """Return Numba's type of a value.

    Types of arrays and tuples are kept: to find those of all arrays of a simulator takes longer than to make
    the arrays.
    """
    parts: list[numba.types.Type] = []
    if type(value) is np.ndarray:
        flags, dtype = value.flags, value.dtype
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

    If it is a kernel, it asks for the types once. Numba does at every call, which for a simulator's sixty
    arrays takes five times as long as the call itself. Nobody checks afterwards: arguments of other types
    are read as if they were of the first. So callers make all arrays themselves, and convert what they were
    given to one type: an int to int, a flag to bool. Where Numba checks bounds (``NUMBA_BOUNDSCHECK=1``),
    the types of every call are compared, and others are an error.
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
    """Folder of compiled code: ``$SPRINGGYM_CACHE_DIR``, else the user's cache folder; None if homeless.

    What the system's variables say counts if it is an absolute path: entries are run, and those of whatever
    folder Python is started from are not one's own.
    """
    if chosen := os.environ.get("SPRINGGYM_CACHE_DIR"):
        return Path(chosen).absolute()
    if sys.platform == "win32":
        named, usual = os.environ.get("LOCALAPPDATA", ""), "~/AppData/Local"
    elif sys.platform == "darwin":
        named, usual = "", "~/Library/Caches"
    else:
        named, usual = os.environ.get("XDG_CACHE_HOME", ""), "~/.cache"
    if os.path.isabs(named):
        return Path(named) / PACKAGE
    try:
        home = Path(usual).expanduser()
    except RuntimeError:  # a user without a home, as in some containers
        return None
    return home / PACKAGE if home.is_absolute() else None


def _asked(found: CompileResult, sig: Asked) -> CompileResult:
    """Return what the cache gave, under the types that were asked for. Types of a script's own classes are
    new in each process."""
    args, _ = sigutils.normalize_signature(sig)
    if found.signature.args == tuple(args):
        return found
    return found._replace(signature=found.signature.replace(args=tuple(args)))


def _machine_code(parts: tuple[Any, ...]) -> tuple[object, ...]:
    """Return the data that Numba keeps of a function, without bitcode: most of it, and needed only to inline.

    Compiled functions that call it find its machine code by its name. Numba's listing of the types of its
    variables, the one text among the data, is left out, too: nobody reads it, and it names the file.
    """
    (name, kind, (machine_code, _)), *others = parts
    kept = (name, kind, (machine_code, binding.parse_assembly("").as_bitcode()))
    return kept, *("" if isinstance(one, str) else one for one in others)


def _name_symbols(codegen: JITCPUCodegen, description: FunctionDescriptor) -> None:
    """Register the names of a function's machine code with Numba's engine, in place of the bitcode."""
    names = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
    functions = [SimpleNamespace(name=name, is_declaration=False) for name in names]
    NAME_SYMBOLS(codegen._engine, SimpleNamespace(functions=functions, global_variables=[]))


KERNELS = "springgym_kernels"
"""Package of compiled code, made by ``tools/kernels.py`` of a clone: a folder of entries, and `MADE`."""

MADE = "made.json"
"""File in it: ``{"versions": {…}, "levels": […]}``, of what its code is made for; see `made_here`."""


def made_here() -> dict[str, str]:
    """Return the versions that the code of `KERNELS` must be made for, to be used by this process."""
    return {PACKAGE: __version__, **VERSIONS}


@cache
def shipped() -> tuple[Path, str] | None:
    """Return the folder of `KERNELS` and the level whose code is for this process.

    None if it is not installed, if ``SPRINGGYM_CPU`` or Numba's settings say what to compile for, or if it
    does not fit: then a warning is logged that says why.
    """
    if os.environ.get("SPRINGGYM_CPU") or numba.config.CPU_NAME or numba.config.CPU_FEATURES is not None:
        return None
    try:
        spec = importlib.util.find_spec(KERNELS)
    except ValueError:  # somebody put a module of this name together
        spec = None
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)))
    level = fitting_level(binding.get_host_cpu_name(), features())
    try:
        made = json.loads((folder / MADE).read_text(encoding="utf-8"))
        versions, levels = dict(made["versions"]), list(map(str, made["levels"]))
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
"""A user who waits for code to be compiled is told so after this long [s]."""

_TOLD = threading.Lock()
"""Held once somebody was told."""

_KERNELS = itertools.count(1)
"""Counts the kernels that this process compiles."""


def _report_compiling(over: threading.Event, kernel: int) -> None:
    """Say that a kernel is being compiled, until it is ``over``.

    On a terminal, a line counts the seconds, and is then erased. Elsewhere, or if logging is configured, a
    line is logged once a process.
    """
    logs = LOGGER.hasHandlers() or not LOGGER.isEnabledFor(logging.WARNING)
    if logs or sys.stderr is None or not sys.stderr.isatty():
        if _TOLD.acquire(blocking=False):
            LOGGER.warning(
                "springgym: compiling kernels. This takes seconds to a minute, once; later runs start at "
                "once. The command `springgym compile` compiles in advance"
            )
        return
    began = time.perf_counter() - PATIENCE
    while not over.wait(1.0):
        seconds = time.perf_counter() - began
        sys.stderr.write(f"\rspringgym: compiling kernel {kernel} (once, up to a minute): {seconds:.0f} s")
        sys.stderr.flush()
    sys.stderr.write("\r\033[K")


class DigestKeyedCache:
    """Numba's cache interface over one file an entry, named by a hash of all it depends on."""

    cache_path = None
    """for Numba's statistics"""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._waiting: threading.Timer | None = None

    def flush(self) -> None:
        """Nothing is ever out of date."""

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
        """Note that nothing is compiled any more."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.cancel()
            waiting.join()  # who forks next should be alone

    def _load(self, sig: Asked, target_context: CPUContext) -> CompileResult | None:
        try:
            target_context.refresh()
            for path in self._places(sig, target_context.codegen()):
                if (found := self._read(path, sig, target_context)) is not None:
                    return found
        except Exception:  # Numba's inside is another than it was
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
        except Exception:  # it is compiled anew, and replaced
            return None

    def save_overload(self, sig: Asked, data: CompileResult) -> None:
        """Save a compiled function."""
        try:
            folder, code = cache_directory(), self._digest(sig)
            if folder is None or code is None:
                return
            path = folder / self._name(code, data.codegen.magic_tuple())
            payload = DUMPS(_machine_code(REDUCE(data)))
        except (AttributeError, TypeError, ValueError) as error:  # Numba's inside is another than it was
            _warn_uncached(f"cannot be asked for its compiled code ({error})")
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{uuid4().hex}.tmp")
            try:
                with temporary.open("xb") as file:  # who may read it, the umask says
                    file.write(_checksum(path, payload) + payload)
                os.replace(temporary, path)  # readers see a whole entry or none
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        except OSError:
            pass  # a read-only or full disk costs a compilation, not the program

    def _places(self, sig: Asked, codegen: JITCPUCodegen) -> Iterator[Path]:
        """Yield the files in which the code may be: one's own entry, then what is shipped."""
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
        """Return the name of the entry: ``target`` is for what code is made, as Numba tells it."""
        settings = [str(getattr(numba.config, name, None)) for name in SETTINGS]
        key = hashlib.sha256(repr((VERSIONS, target, settings)).encode() + code).hexdigest()
        return f"{self._function.__module__}.{self._function.__name__}-{key}.nbc"


DIGEST = hashlib.sha256().digest_size
"""Length of the checksum that an entry begins with [bytes]."""


def _checksum(path: Path, payload: bytes) -> bytes:
    """Hash of what an entry holds and of its name: one that was renamed is another's."""
    return hashlib.sha256(path.name.encode() + payload).digest()
