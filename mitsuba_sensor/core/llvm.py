"""Choice of the LLVM library that Dr.Jit loads, and the import of Dr.Jit.

Dr.Jit initialises LLVM when it is *imported*, so :func:`guard_llvm` chooses the library before, when this package is
imported. It reads versions from file names and ELF sonames without loading libraries. drjit 1.5.0 rejects LLVM 14, and
LLVM 15 and 16 abort the process (they cannot select ``llvm.maximum``); 19, 22 and 23 work. This package imports Dr.Jit
only through :func:`drjit`.

Libraries of the operating system come first. If there is none, karellen-llvm-core from the Python package index
installs one in the environment of this interpreter, without root rights.
"""

import contextlib
import glob
import importlib
import os
import re
import site
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType

OLDEST_LLVM = 17
LLVM_PATH = "DRJIT_LIBLLVM_PATH"
GIVEN_PATH = os.environ.get(LLVM_PATH)  # the user's, before this package changes it
NO_LIBRARY = os.devnull  # for Dr.Jit if no LLVM is usable; it then reports that it found none

# Dr.Jit searches $LD_LIBRARY_PATH and /usr/lib/<triplet>; distributions, Conda and Homebrew use other folders.
FOLDERS: tuple[str, ...] = (
    *filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(":")),
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
)
FOLDERS += ("/usr/local/lib", "/usr/lib/llvm-*/lib", "/usr/lib/llvm/*/lib64")
FOLDERS += ("/opt/homebrew/opt/llvm*/lib", "/usr/local/opt/llvm*/lib")
# This interpreter's environment, where pip, Conda and uv put libraries.
OWN_FOLDERS: tuple[str, ...] = (
    os.path.join(sys.prefix, "lib"),
    os.path.join(site.getuserbase(), "lib"),
)
NAMES = "libLLVM[-.]*dylib" if sys.platform == "darwin" else "libLLVM[-.]*so*"
DRJIT_CAME_FIRST = "drjit" in sys.modules  # imported, with an LLVM, before this package

# Dependencies of karellen-llvm-core's libLLVM, in load order. It creates links to them if its folder is writable; a
# loaded library needs no link.
COMPANIONS = ("libunwind.so.1.0", "libc++abi.so.1.0", "libc++.so.1.0")
ON_THE_INDEX = sys.platform == "linux" and os.uname().machine == "x86_64"
INSTALL = "apt-get install libllvm19"
if ON_THE_INDEX:
    INSTALL = "pip install karellen-llvm-core, or apt-get install libllvm19"


@dataclass(frozen=True)
class LlvmLibrary:
    """An LLVM library file on this machine.  version : major version, 0 if unknown."""

    path: str
    version: int
    usable: bool
    reason: str


def find_llvm(folders: tuple[str, ...] = ()) -> list[LlvmLibrary]:
    """Return all LLVM libraries in these folders (glob patterns) without loading them, newest first.

    $DRJIT_LIBLLVM_PATH comes first, then libraries of the operating system, then of this environment.
    """
    libraries = _libraries_in(folders or FOLDERS)
    if not folders:
        libraries += _libraries_in(OWN_FOLDERS)
    named = os.environ.get(LLVM_PATH, "")
    if named and named != NO_LIBRARY:
        libraries.insert(0, inspect_llvm(named))
    return list({library.path: library for library in libraries}.values())


def _libraries_in(folders: tuple[str, ...]) -> list[LlvmLibrary]:
    """Return all LLVM libraries in these folders (glob patterns), newest first."""
    paths = {
        os.path.realpath(path)
        for folder in folders
        for path in glob.glob(os.path.join(folder, NAMES))
    }
    return sorted(map(inspect_llvm, sorted(paths)), key=lambda library: -library.version)


def inspect_llvm(path: str) -> LlvmLibrary:
    """Return version and usability of a library file, from its name and its bytes."""
    real, version, reason = os.path.realpath(path), 0, "usable"
    try:
        with open(real, "rb") as file:
            if not _same_architecture(file.read(20)):
                reason = "not a shared library for this processor"
            elif (version := _version_of(real)) < OLDEST_LLVM:
                reason = f"older than {OLDEST_LLVM}: Dr.Jit refuses it or aborts the process"
                if not version:
                    reason = "has no LLVM version in its name or soname"
    except (OSError, ValueError) as error:
        reason = f"cannot be read ({error})"
    return LlvmLibrary(real, version, reason == "usable", reason)


def _version_of(path: str) -> int:
    """Return the major version in the name (libLLVM-15.so.1, libLLVM.so.19.1), soname or symbols (LLVM_19.1)."""
    if named := re.search(r"LLVM(?:-|\.so\.|\.)(\d+)", os.path.basename(path)):
        return int(named[1])
    import mmap

    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        match = re.search(rb"\0libLLVM(?:-|\.so\.)(\d+)[^\0]*\0|\0LLVM_(\d+)[.0-9]*\0", data)
        return int(match[1] or match[2]) if match else 0


def _same_architecture(head: bytes) -> bool:
    """Return True if an ELF header has the address size, byte order and processor of this interpreter."""
    if sys.platform != "linux":
        return len(head) == 20
    with open(os.path.realpath("/proc/self/exe"), "rb") as file:
        mine = file.read(20)
    return head[:6] == mine[:6] and head[18:20] == mine[18:20]


def guard_llvm() -> LlvmLibrary | None:
    """Make Dr.Jit load the first usable library at its import, and return this library.

    If no library is usable, Dr.Jit gets none. If there are no libraries, it searches itself.
    """
    libraries = find_llvm()
    library = _first_usable(libraries)
    if library:
        if os.path.realpath(os.environ.get(LLVM_PATH, "")) != library.path:
            os.environ[LLVM_PATH] = library.path
        _load_companions(library.path)
    elif libraries:
        os.environ[LLVM_PATH] = NO_LIBRARY
    return library


def _first_usable(libraries: list[LlvmLibrary]) -> LlvmLibrary | None:
    return next((library for library in libraries if library.usable), None)


def _load_companions(path: str) -> None:
    """Load the dependencies of a libLLVM from the package index, if their links are missing."""
    for name in COMPANIONS:
        pattern = os.path.join(os.path.dirname(path), "*-unknown-linux-gnu", name)
        for companion in glob.glob(pattern):
            if not os.path.exists(companion.removesuffix(".0")):
                import ctypes

                with contextlib.suppress(OSError):  # backend_problem then explains it
                    ctypes.CDLL(companion)


def _why_not_loaded(path: str) -> str:
    """Return the error of the dynamic linker for a library that Dr.Jit did not load."""
    import ctypes

    try:
        ctypes.CDLL(path)
    except OSError as error:
        return str(error).removeprefix(f"{path}: ")
    return "it lacks symbols that Dr.Jit needs"


def drjit() -> ModuleType:
    """Return Dr.Jit, imported after :func:`guard_llvm`."""
    with guarded_import():
        return importlib.import_module("drjit")


def guarded_import() -> contextlib.AbstractContextManager[None]:
    """Return a context for importing Dr.Jit, with the library chosen and no warning if there is none."""
    silent = "drjit" not in sys.modules and guard_llvm() is None
    return _silence() if silent else contextlib.nullcontext()


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Suppress stderr of C code: Dr.Jit's warning about a missing LLVM library."""
    sys.stderr.flush()
    saved, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nothing)


def llvm_version() -> int:
    """Return the major version of the LLVM that Dr.Jit loaded, 0 if none."""
    dr = drjit()
    if dr.has_backend(dr.JitBackend.LLVM):
        return max(int(dr.detail.llvm_version()[0]), 0)
    return 0


def backend_problem(backend: str) -> str | None:
    """Return why this backend (scalar, llvm, cuda) is unavailable in this process, or None."""
    dr = drjit()
    if backend == "cuda":
        if dr.has_backend(dr.JitBackend.CUDA):
            return None
        return "no CUDA device or driver"
    if backend == "llvm" and (version := llvm_version()) < OLDEST_LLVM:
        path = os.environ.get(LLVM_PATH, NO_LIBRARY)
        if version:
            early = DRJIT_CAME_FIRST * " and was loaded before mitsuba_sensor was imported"
            return f"only LLVM {version}, which aborts the process{early}"
        if DRJIT_CAME_FIRST and _first_usable(find_llvm()):
            return "no LLVM in Dr.Jit, which was imported before mitsuba_sensor and found no usable library"
        if path != NO_LIBRARY:
            return f"no LLVM that can be loaded ({path}: {_why_not_loaded(path)})"
        return f"no LLVM {OLDEST_LLVM} or newer on this machine"
    return None


def llvm_remedy() -> str:
    """Return how to obtain the LLVM backend."""
    library = _first_usable(find_llvm())
    if library is None or not (DRJIT_CAME_FIRST or llvm_version()):
        return INSTALL
    order = DRJIT_CAME_FIRST * "import mitsuba_sensor before mitsuba and drjit, or "
    return f"{order}start Python with {LLVM_PATH}={library.path}"
