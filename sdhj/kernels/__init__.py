"""All compiled code, and how it is compiled."""
