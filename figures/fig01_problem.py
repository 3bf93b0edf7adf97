"""Fig. 1: the problem: a robot arm, known moving disks, an unpredictable agent."""

from sdhj.figures import script

if __name__ == "__main__":
    script(1)()
