"""Calls in a process that may write only small files, as on a disk without space."""

import json
import subprocess
import sys
from textwrap import dedent

# The limit holds for every file of the process, the test's own log too: hence another process.
END = """
import json, resource, signal, sys
space = int(sys.argv[2])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (space, space))
errors = []
for call in calls:
    try:
        call()
        errors.append("none")
    except OSError as error:
        errors.append(str(error))
print(json.dumps(errors))
"""


def errors_without_space(script, folder, space):
    """What the `calls` that a script defines say, each an OSError's text or "none".

    Its sys.argv[1] is the folder; a file may have `space` bytes. A process that VTK ends fails.
    """
    done = subprocess.run(
        [sys.executable, "-c", dedent(script) + END, str(folder), str(space)],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])
