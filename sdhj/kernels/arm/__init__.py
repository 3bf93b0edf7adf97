"""Compiled geometry of an arm of two links, for its own proof (`sdhj.certified.arm`) alone."""
