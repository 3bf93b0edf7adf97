"""Plays the car of `sdhj new` against a program that reads measurements and writes commands; counts runs that are lost.

    python judge.py ./loop robot/sdhj_table.bin

Nothing of sdhj is imported: the car, the wind, the post and the goal are written down here once more.
"""

import subprocess
import sys

import numpy as np

DELTA, STEPS, WIND, SUBSTEPS, RUNS = 0.25, 8, 0.1, 50, 1000
POST, GOAL = (0.0, 0.0, 0.4), (1.2, 0.8, 0.4)
WINDS = ("towards the post", "away from the goal", "at random", "turning")


def level(q, disk):
    """Distance to a disk, negative inside."""
    return np.hypot(q[0] - disk[0], q[1] - disk[1]) - disk[2]


def wind_at(kind, q, t, rng):
    """The wind at an instant, within its bounds."""
    if kind == "at random":
        return rng.uniform(-WIND, WIND, 2)
    if kind == "turning":
        return WIND * np.sign([np.cos(9 * t), np.sin(9 * t)])
    towards = -q[:2] if kind == "towards the post" else q[:2] - GOAL[:2]
    return WIND * np.sign(towards)


def held(q, speed, turn, kind, t, rng):
    """The states while a command is held, by the midpoint rule in short steps."""
    h = DELTA / SUBSTEPS
    for part in range(SUBSTEPS):
        wind, heading = wind_at(kind, q, t + part * h, rng), q[2] + turn * h / 2
        q = q + h * np.array([speed * np.cos(heading) + wind[0], speed * np.sin(heading) + wind[1], turn])
        yield q


def run(ask, q, kind, rng):
    """What becomes of a run: reached, or how it is lost; None where the program promises nothing at its start."""
    for step in range(STEPS + 1):
        if level(q, GOAL) <= 0:
            return "reached"
        status, speed, turn = ask(step, q)
        if status != 0:
            return None if step == 0 else "a promise was not kept"
        if step == STEPS:
            return "late"
        for at in held(q, speed, turn, kind, step * DELTA, rng):
            if level(at, POST) <= 0:
                return "hit the post"
            if max(abs(at[0]), abs(at[1])) > 2:
                return "left the plane"
        q = at


def main():
    program = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(step, q):
        program.stdin.write(f"{step} {' '.join(map(repr, q.tolist()))}\n")
        program.stdin.flush()
        status, _, speed, turn = program.stdout.readline().split()
        return int(status), float(speed), float(turn)

    rng, counts = np.random.default_rng(0), {}
    while sum(counts.values()) < RUNS:
        outcome = run(ask, rng.uniform([-2, -2, -np.pi], [2, 2, np.pi]), WINDS[sum(counts.values()) % 4], rng)
        if outcome is not None:
            counts[outcome] = counts.get(outcome, 0) + 1
    program.stdin.close()
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.items()), "of", RUNS, "runs")
    return 0 if counts == {"reached": RUNS} else 1


if __name__ == "__main__":
    sys.exit(main())
