"""Look-up tables, the controller that reads them (Algorithm 2), and their files."""
