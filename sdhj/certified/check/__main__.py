"""`python -m sdhj.certified.check table.npz`: the verdict on a file.

The exit status is 1 where a claim is not proved, and 2 where none can be read.
"""

import sys

from sdhj.certified.check import verify

if len(sys.argv) != 2:
    sys.exit("usage: python -m sdhj.certified.check TABLE.npz")
try:
    verdict = verify(sys.argv[1])
except (OSError, ValueError, MemoryError) as error:
    print(f"Error: {error}", file=sys.stderr)
    sys.exit(2)
print(verdict)
sys.exit(0 if verdict.ok else 1)
