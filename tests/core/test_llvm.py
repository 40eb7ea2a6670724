"""The LLVM guard: versions are read without loading, and a library that aborts the process is never loaded.

Each question about Dr.Jit is asked in a process of its own, because it initialises LLVM when it is imported. Fake
libraries are an ELF header and a name: whoever tries to load one fails loudly.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.marks import exhaustive
from helpers.waiting import WAIT_S

from mitsuba_sensor.core import llvm
from mitsuba_sensor.core.llvm import LLVM_PATH, find_llvm, inspect_llvm

ONE_FOLDER = f"""
import importlib.util, os, sys
spec = importlib.util.spec_from_file_location("mitsuba_sensor.core.llvm", {llvm.__file__!r})
llvm = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
def look_into_one_folder():
    spec.loader.exec_module(llvm)
    llvm.FOLDERS, llvm.OWN_FOLDERS = (sys.argv[1],), ()
"""
"""Code before the import of the package, which chooses the library: only libraries in one folder are found."""

REPORT = (
    ONE_FOLDER
    + """
import json
look_into_one_folder()
from mitsuba_sensor.render import variants
chosen = variants.choose_variant()
mi = variants.use(chosen)
scene = mi.load_dict({"type": "scene", "s": {"type": "sphere"}, "e": {"type": "constant"}, "i": {"type": "direct"},
                      "c": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}})
mean = float(mi.TensorXf(mi.render(scene, spp=4)).array[0]) if chosen.backend == "scalar" else 0.0
maps = open("/proc/self/maps").read() if os.path.exists("/proc/self/maps") else ""
loaded = sorted({line.split()[-1] for line in maps.splitlines() if "LLVM" in line})
print(json.dumps([chosen.name, chosen.hint, chosen.reason, loaded]))
"""
)
linux = pytest.mark.skipif(
    sys.platform != "linux", reason="looks into /proc/self/maps and makes ELF files"
)


def fake_library(folder: Path, name: str, inside: bytes = b"") -> Path:
    """Write a file with the header of this interpreter and the name of a library."""
    head = Path(os.path.realpath(sys.executable)).read_bytes()[:64]
    path = folder / name
    path.write_bytes(head + b"\0" * 64 + inside)
    return path


def in_new_process(
    code: str, *arguments: object, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Return code that runs if the user named no LLVM library."""
    env = {k: v for k, v in os.environ.items() if k != LLVM_PATH} | environment
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=env, timeout=WAIT_S)
    assert done.returncode == 0, done.stderr
    return done


def import_drjit(folder: Path, **environment: str) -> tuple[list, str]:
    """Return the choice of a new process that searches for LLVM in ``folder`` alone, and its stderr."""
    done = in_new_process(REPORT, folder, **environment)
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def poison(folder: Path) -> Path:
    """LLVM 15 of the machine, or else a fake."""
    real = [one for one in find_llvm() if one.version == 15]
    if not real:
        return fake_library(folder, "libLLVM-15.so.1")
    link = folder / "libLLVM-15.so.1"
    link.symlink_to(real[0].path)
    return link


@linux
@pytest.mark.parametrize("named", [*map(exhaustive, ("nothing", "no library")), "the poison"])
def test_llvm_15_is_never_loaded_and_scalar_renders(tmp_path: Path, named: str) -> None:
    """Whatever the environment names."""
    path = {"nothing": {}, "no library": {LLVM_PATH: os.devnull}}
    path["the poison"] = {LLVM_PATH: str(poison(tmp_path))}
    (name, hint, reason, loaded), errors = import_drjit(tmp_path, **path[named])
    assert (name, loaded, errors) == ("scalar_spectral", [], "")
    assert "libllvm19" in hint and "three times faster" in hint and "\n" not in hint
    assert "17" in reason


def usable_beside_poison(folder: Path) -> str:
    """Put LLVM 15 and a usable library in a folder; return the path of the latter."""
    usable = [one for one in find_llvm() if one.usable]
    if not usable:
        pytest.skip("no LLVM 17 or newer on this machine")
    poison(folder)
    (folder / os.path.basename(usable[0].path)).symlink_to(usable[0].path)
    return usable[0].path


STEPS = {
    "ms": "look_into_one_folder(); import mitsuba_sensor as ms",
    "mi": "import mitsuba as mi",
    "set": "mi.set_variant('llvm_ad_spectral')",
    "ms.render": "ms.render(sys.argv[2], 'konnik_table1', ms.Exposure(0.1), spp=1, progress=False)",
    "mi.render": "import drjit as dr; dr.eval(mi.render(mi.load_file(sys.argv[2]), spp=1)); dr.sync_thread()",
}


@linux
@pytest.mark.parametrize(
    "order",
    [
        "ms mi set mi.render ms.render",
        exhaustive("ms ms.render mi mi.render"),
        exhaustive("ms mi set ms.render mi.render"),
        exhaustive("ms ms.render mi set mi.render"),
    ],
)
def test_every_workable_order_of_imports_renders(
    tmp_path: Path, scene_file: Path, order: str
) -> None:
    """This package chooses LLVM on import; with LLVM 15, mi.render would abort the process."""
    usable = usable_beside_poison(tmp_path)
    steps = [STEPS[step] for step in order.split()]
    report = "print(mi.variant(), *(l.split()[-1] for l in open('/proc/self/maps') if 'libLLVM' in l))"
    done = in_new_process("\n".join([ONE_FOLDER, *steps, report]), tmp_path, scene_file)
    variant, *loaded = done.stdout.splitlines()[-1].split()
    assert (variant, {*loaded}) == ("llvm_ad_spectral", {usable})


@linux
@pytest.mark.parametrize(
    ("name", "inside", "version"),
    [
        ("libLLVM-15.so.1", b"", 15),
        ("libLLVM-14.0.6.so.1", b"", 14),
        ("libLLVM.so.22.0-rc1", b"", 22),
        ("libLLVM.so", b"\0libLLVM.so.18.1\0", 18),
        ("mine.so", b"x\0libLLVM-15.so.1\0", 15),
        ("blank.so", b"", 0),
    ],
)
def test_the_version_is_read_from_file_name_or_soname(
    tmp_path: Path, name: str, inside: bytes, version: int
) -> None:
    found = inspect_llvm(str(fake_library(tmp_path, name, inside)))
    assert (found.version, found.usable) == (version, version >= 17)


@linux
def test_libraries_of_other_machines_and_broken_ones_are_not_usable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(LLVM_PATH, raising=False)
    (tmp_path / "libLLVM.so.20.1").write_text("GROUP ( libLLVM.so )")
    (tmp_path / "libLLVM.so.21.1").write_bytes(b"")
    (tmp_path / "libLLVM-19.so").symlink_to(tmp_path / "missing")
    assert [one.usable for one in find_llvm((str(tmp_path),))] == [False] * 3


@linux
def test_a_system_library_precedes_a_newer_one_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, own = tmp_path / "system", tmp_path / "own"
    for folder, name in (
        (system, "libLLVM.so.19.1"),
        (system, "libLLVM-15.so.1"),
        (own, "libLLVM.so.23.1"),
    ):
        folder.mkdir(exist_ok=True)
        fake_library(folder, name)
    monkeypatch.delenv(LLVM_PATH, raising=False)
    monkeypatch.setattr(llvm, "FOLDERS", (str(system),))
    monkeypatch.setattr(llvm, "OWN_FOLDERS", (str(own),))
    assert [library.version for library in find_llvm()] == [19, 15, 23]
    assert [library.version for library in find_llvm() if library.usable] == [19, 23]
    monkeypatch.setenv(LLVM_PATH, str(own / "libLLVM.so.23.1"))
    assert [library.version for library in find_llvm()] == [23, 19, 15], "a named one is first"


@linux
def test_a_library_that_fails_to_load_is_named_with_the_reason(tmp_path: Path) -> None:
    """The header of this interpreter alone: the dynamic linker refuses it, and scalar renders."""
    path = fake_library(tmp_path, "libLLVM.so.23.1")
    (name, hint, reason, loaded), _ = import_drjit(tmp_path)
    assert (name, loaded) == ("scalar_spectral", [])
    assert f"no LLVM that can be loaded ({path}: " in reason
    assert "libllvm19" in hint


@linux
def test_dependencies_of_an_installed_library_are_loaded_without_links(tmp_path: Path) -> None:
    """A library that needs another by a name that no file has, as libLLVM needs libc++.so.1.

    Both are built here; without the first, the linker does not find it."""
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc to build two small libraries")
    beside = tmp_path / "x86_64-unknown-linux-gnu"
    beside.mkdir()
    (tmp_path / "a.c").write_text("int a(void) { return 42; }")
    (tmp_path / "b.c").write_text("int a(void); int b(void) { return a(); }")
    needed, library = beside / "libc++.so.1.0", tmp_path / "libLLVM.so.23.1"
    build = ["gcc", "-shared", "-fPIC"]
    subprocess.run(
        [*build, "-Wl,-soname,libc++.so.1", "-o", needed, tmp_path / "a.c"], check=True
    )
    subprocess.run(
        [*build, "-Wl,-soname,libLLVM.so.23.1", "-o", library, tmp_path / "b.c", needed],
        check=True,
    )
    code = f"""
import ctypes
import os
from mitsuba_sensor.core import llvm
os.environ.pop(llvm.LLVM_PATH, None)  # set by the import of the package
llvm.FOLDERS, llvm.OWN_FOLDERS = ({str(tmp_path)!r},), ()
assert llvm.guard_llvm().version == 23
assert ctypes.CDLL({str(library)!r}).b() == 42
"""
    env = {name: value for name, value in os.environ.items() if name != LLVM_PATH}
    subprocess.run([sys.executable, "-c", code], check=True, timeout=WAIT_S, env=env)
    alone = f"import ctypes; ctypes.CDLL({str(library)!r})"
    refused = subprocess.run(
        [sys.executable, "-c", alone], capture_output=True, text=True, timeout=WAIT_S
    )
    assert "libc++.so.1" in refused.stderr
