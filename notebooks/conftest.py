"""`pytest --nbval-lax notebooks/` runs the chapters. No plugin of pytest is loaded by itself: see pyproject.toml."""

import importlib.util

pytest_plugins = ["nbval.plugin"] if importlib.util.find_spec("nbval") else []
