"""A new process on one core: a process that has imported PyTorch or JAX keeps its number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

ONE_CORE = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
    "OMP_NUM_THREADS": "1",
}
PRECISIONS = ("float32", "float64")


def in_new_process(module: str, call: str) -> Any:
    """Return the value of a call of a function of a module; it must fit JSON."""
    code = f"import json\nfrom {module} import *\nprint(json.dumps({call}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_CORE,
        start_new_session=True,  # Ctrl-C is for this process, which ends the other
    )
    return json.loads(done.stdout.splitlines()[-1])
