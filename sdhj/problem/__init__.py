"""The robust motion planning problem of Sec. 2 and 3."""
