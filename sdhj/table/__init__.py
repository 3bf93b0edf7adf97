"""Look-up tables, the controller that reads them, and their files."""
