"""The claims of the file of an arm, checked by geometry of its own: no part of it is used for any other robot."""
