"""`python -m sdhj.certified.check table.h5`: the verdict on a file, exit status 1 where a claim is not proved."""

import sys

from sdhj.certified.check import verify

if len(sys.argv) != 2:
    sys.exit("usage: python -m sdhj.certified.check TABLE.h5")
verdict = verify(sys.argv[1])
print(verdict)
sys.exit(0 if verdict.ok else 1)
