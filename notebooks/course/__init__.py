"""What the chapters lean on: `draw` pictures, `explore` widgets, `checks` the exercises of a chapter each."""
