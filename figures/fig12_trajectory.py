"""Fig. 12: a run in workspace and configuration space, with an animation."""

from sdhj.figures import script

if __name__ == "__main__":
    script(12)()
