"""CasADi functions as machine code, where a C compiler is found: the same results to the bit, several times as fast.

Compiling takes from half a second (an arm) to eight (two arms in a closed chain, a step with two Newton iterations), so
it is done on demand only, and kept in the user's cache from then on, by expression, CasADi, compiler and processor.
"""

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca

from pipeline.cache import cache_folder

log = logging.getLogger(__name__)
# No contraction into fused multiply-adds: results stay those of CasADi's own evaluation. More optimisation gains
# nothing and doubles the time to compile.
_FLAGS = ("-O1", "-ffp-contract=off", "-fPIC", "-shared")


def native(function: ca.Function, kept_only: bool = False) -> ca.Function | None:
    """Return a function as machine code; None without a compiler, or where it fails, which is logged.

    Args:
        function: to compile.
        kept_only: take it from the cache, and where it is not there return None.
    """
    compiler = find_compiler()
    if compiler is None:
        log.debug("no C compiler: %s is evaluated by CasADi", function.name())
        return None
    place = [ca.CasadiMeta.version(), os.path.realpath(compiler), platform.machine(), function.name()]
    key = hashlib.sha256("\0".join([*_FLAGS, *place, function.serialize()]).encode()).hexdigest()[:32]
    library = cache_folder() / f"{key}.so"
    if not library.is_file():
        if kept_only:
            return None
        try:
            _compile(compiler, function, library)
        except (OSError, subprocess.SubprocessError) as error:
            log.warning("%s cannot be compiled (%s): it is evaluated by CasADi", function.name(), error)
            return None
    try:
        return ca.external(function.name(), str(library))
    except RuntimeError as error:
        log.warning("%s cannot be loaded (%s): it is evaluated by CasADi", library, str(error).splitlines()[0])
        return None


def find_compiler() -> str | None:
    """Return the path of a C compiler; None where there is none."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def _compile(compiler: str, function: ca.Function, library: Path) -> None:
    """Compile beside the place it is kept at, and move it there: a killed run leaves nothing half-written."""
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        written, made = Path(folder) / "function.c", Path(folder) / "function.so"
        written.write_text(generator.dump())
        subprocess.run([compiler, *_FLAGS, str(written), "-o", str(made)], check=True, capture_output=True)
        made.replace(library)
