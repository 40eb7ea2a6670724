"""Choice of the LLVM library that Dr.Jit loads, and the import of Dr.Jit.

Dr.Jit initialises LLVM when it is *imported*, so the library is chosen before: versions are read from file names and
ELF sonames, without loading a library. drjit 1.5.0 refuses LLVM 14, and 15 and 16 abort the process (they cannot select
``llvm.maximum``); 19, 22 and 23 are known to work. The library is chosen when this package is imported, by
:func:`guard_llvm`; the package itself imports Dr.Jit through :func:`drjit` only.

Libraries of the operating system come first. Where it has none, the package karellen-llvm-core of the Python package
index brings one into the environment of this interpreter, without root rights.
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
GIVEN_PATH = os.environ.get(LLVM_PATH)  # by the user, before this package changes it
NO_LIBRARY = (
    os.devnull
)  # the path that Dr.Jit gets when no LLVM is usable; it then finds none and says so

# Dr.Jit searches $LD_LIBRARY_PATH and /usr/lib/<triplet>; Linux distributions, Conda and Homebrew use the others.
FOLDERS: tuple[str, ...] = (
    *filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(":")),
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
)
FOLDERS += ("/usr/local/lib", "/usr/lib/llvm-*/lib", "/usr/lib/llvm/*/lib64")
FOLDERS += ("/opt/homebrew/opt/llvm*/lib", "/usr/local/opt/llvm*/lib")
# Of this interpreter's environment, where pip, Conda and uv put libraries.
OWN_FOLDERS: tuple[str, ...] = (
    os.path.join(sys.prefix, "lib"),
    os.path.join(site.getuserbase(), "lib"),
)
NAMES = "libLLVM[-.]*dylib" if sys.platform == "darwin" else "libLLVM[-.]*so*"
DRJIT_CAME_FIRST = "drjit" in sys.modules  # it was imported, with an LLVM, before this package


# What libLLVM of karellen-llvm-core needs, in the order of their needs. Its own links to them appear when Python is
# started by somebody who may write to its folder; a library that is loaded already needs no link.
COMPANIONS = ("libunwind.so.1.0", "libc++abi.so.1.0", "libc++.so.1.0")
ON_THE_INDEX = sys.platform == "linux" and os.uname().machine == "x86_64"
INSTALL = "apt-get install libllvm19"
if ON_THE_INDEX:
    INSTALL = "pip install karellen-llvm-core, or apt-get install libllvm19"


@dataclass(frozen=True)
class LlvmLibrary:
    """One LLVM library file on this machine. version : major version, 0 if unknown."""

    path: str
    version: int
    usable: bool
    reason: str


def find_llvm(folders: tuple[str, ...] = ()) -> list[LlvmLibrary]:
    """All LLVM libraries in these folders (glob patterns), none loaded: $DRJIT_LIBLLVM_PATH first, then those of the
    operating system, then those of this environment, the newest first."""
    found = _libraries_in(folders or FOLDERS)
    if not folders:
        found += [library for library in _libraries_in(OWN_FOLDERS) if library not in found]
    named = os.environ.get(LLVM_PATH, "")
    if named and named != NO_LIBRARY:
        first = [inspect_llvm(named)]
    else:
        first = []
    return first + [
        library for library in found if not first or library.path != os.path.realpath(named)
    ]


def _libraries_in(folders: tuple[str, ...]) -> list[LlvmLibrary]:
    """All LLVM libraries in these folders (glob patterns), the newest first."""
    paths = {
        os.path.realpath(path)
        for folder in folders
        for path in glob.glob(os.path.join(folder, NAMES))
    }
    return sorted(map(inspect_llvm, sorted(paths)), key=lambda library: -library.version)


def inspect_llvm(path: str) -> LlvmLibrary:
    """Version and usability of one library file, from its name and its bytes."""
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
    """Major version in the name (libLLVM-15.so.1, libLLVM.so.19.1), else the soname or symbols (LLVM_19.1) inside."""
    named = re.search(r"LLVM(?:-|\.so\.|\.)(\d+)", os.path.basename(path))
    if named:
        return int(named.group(1))
    import mmap

    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        match = re.search(rb"\0libLLVM(?:-|\.so\.)(\d+)[^\0]*\0|\0LLVM_(\d+)[.0-9]*\0", data)
        if match:
            return int(match.group(1) or match.group(2))
        return 0


def _same_architecture(head: bytes) -> bool:
    """True if an ELF header has the address size, byte order and processor of this Python interpreter."""
    if sys.platform != "linux":
        return len(head) == 20
    with open(os.path.realpath("/proc/self/exe"), "rb") as file:
        mine = file.read(20)
    return head[:6] == mine[:6] and head[18:20] == mine[18:20]


def guard_llvm() -> LlvmLibrary | None:
    """Tell Dr.Jit, before its import, to load the first usable library; return that library.

    Where all libraries here are unusable Dr.Jit gets none. Where there are none, it looks for one itself.
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
    """Load the libraries that a libLLVM from the package index needs, from a folder beside it, if they lack links."""
    for name in COMPANIONS:
        pattern = os.path.join(os.path.dirname(path), "*-unknown-linux-gnu", name)
        for companion in glob.glob(pattern):
            if not os.path.exists(companion.removesuffix(".0")):
                import ctypes

                with contextlib.suppress(
                    OSError
                ):  # then Dr.Jit has no LLVM, and backend_problem says why
                    ctypes.CDLL(companion)


def _why_not_loaded(path: str) -> str:
    """What the dynamic linker says of a library that Dr.Jit has not loaded."""
    import ctypes

    try:
        ctypes.CDLL(path)
    except OSError as error:
        return str(error).removeprefix(f"{path}: ")
    return "Dr.Jit does not find in it what it needs"


def drjit() -> ModuleType:
    """Dr.Jit, imported after :func:`guard_llvm`."""
    with guarded_import():
        return importlib.import_module("drjit")


def guarded_import() -> contextlib.AbstractContextManager[None]:
    """A block that imports Dr.Jit: its library is chosen before, and where there is none Dr.Jit does not warn."""
    silent = "drjit" not in sys.modules and guard_llvm() is None
    return _silence() if silent else contextlib.nullcontext()


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Suppress what C code writes to stderr: Dr.Jit's warning about the LLVM library that it does not find."""
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
    """Major version of the LLVM that Dr.Jit has loaded, 0 if none."""
    dr = drjit()
    if dr.has_backend(dr.JitBackend.LLVM):
        return max(int(dr.detail.llvm_version()[0]), 0)
    return 0


def backend_problem(backend: str) -> str | None:
    """Why this back end (scalar, llvm, cuda) cannot be used in this process, or None if it can."""
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
            return "no LLVM in Dr.Jit, which was imported before mitsuba_sensor and found none that it can use"
        if path != NO_LIBRARY:
            return f"no LLVM that can be loaded ({path}: {_why_not_loaded(path)})"
        return f"no LLVM {OLDEST_LLVM} or newer on this machine"
    return None


def llvm_remedy() -> str:
    """What gives this process the LLVM back end that it lacks."""
    library = _first_usable(find_llvm())
    if library is None or not (DRJIT_CAME_FIRST or llvm_version()):
        return INSTALL
    order = DRJIT_CAME_FIRST * "import mitsuba_sensor before mitsuba and drjit, or "
    return f"{order}start Python with {LLVM_PATH}={library.path}"
