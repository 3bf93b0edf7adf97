"""Checks of the exercises of chapter 7: finite games, played out by brute force."""

from functools import cache

import numpy as np

from course.exercises import exercise, expect


def _game(seed, states=12, inputs=3, moves=2):
    """A random finite game with most goals in the middle and a few unsafe states."""
    rng = np.random.default_rng(seed)
    step = np.clip(
        np.arange(states)[:, None] + rng.integers(-3, 4, (inputs, 1, 1)) + rng.integers(-1, 2, (inputs, states, moves)),
        0,
        states - 1,
    )
    goal, unsafe = np.zeros((2, states), bool)
    goal[[3, 8]] = True
    unsafe[rng.choice(states, 2, replace=False)] = True
    return step, goal, unsafe


def _wins(step, goal, unsafe):
    """A function (state, n): whether the goal can be forced within n steps."""

    @cache
    def wins(s, n):
        if unsafe[s]:
            return False
        return bool(goal[s]) or (n > 0 and any(all(wins(t, n - 1) for t in moves) for moves in step[:, s].tolist()))

    return wins


@exercise("7.1", "From step k there are N - k intervals left, and nobody needs more than are left.")
def check_rows(entry):
    """min(n, N - k)."""
    for N, k, n, wanted in (
        (8, 0, 8, 8),
        (8, 0, 3, 3),
        (8, 5, 2, 2),
        (8, 5, 3, 3),
        (8, 5, 7, 3),
        (8, 8, 4, 0),
        (4, 3, 4, 1),
    ):
        got = entry(N, k, n)
        expect(got <= N - k, f"N = {N}, k = {k}, n = {n}: that entry is a star, only {N - k} intervals are left.")
        expect(got <= n, f"N = {N}, k = {k}, n = {n}: no more than n steps are allowed.")
        expect(got == wanted, f"N = {N}, k = {k}, n = {n}: the tube is {wanted} columns from the first.")


@exercise("7.2", "tube[step] has the shape of step: `all` over the moves of the adversary, `any` over the inputs.")
def check_tubes(finite_tubes):
    """Against a game played out."""
    for seed in range(30):
        step, goal, unsafe = _game(seed)
        got = np.asarray(finite_tubes(step, goal, unsafe, 4))
        expect(got.shape == (5, 12), "one row for each n from 0 to N, one column for each state.")
        wins = _wins(step, goal, unsafe)
        wanted = np.array([[wins(s, n) for s in range(12)] for n in range(5)])
        expect(got[0] == wanted[0], "n = 0: the goal, less what is unsafe.")
        expect(~got[:, unsafe], "an unsafe state wins, or is used on the way.")
        expect(got[1:] >= got[:-1], "who wins within n - 1 steps wins within n: the union with the tube before.")
        expect(~(got & ~wanted), "some state is called won from which the adversary can prevent it: all v, not some v.")
        expect(got == wanted, "some state is called lost that one of the inputs wins.")


@exercise(
    "7.3",
    "Row n holds states that row n - 1 lacks. Their inputs are those that lead into row n - 1 in any case.",
)
def check_inputs(progress_inputs):
    """Inputs of the leftmost set."""
    for seed in range(30):
        step, goal, unsafe = _game(seed)
        wins = _wins(step, goal, unsafe)
        got = np.asarray(progress_inputs(step, goal, unsafe, 4))
        expect(got.shape == (3, 12), "one row for each input, one column for each state.")
        for s in range(12):
            fewest = next((n for n in range(5) if wins(s, n)), None)
            if not fewest:
                expect(~got[:, s], "in the goal nothing is left to do, and for a lost state no input is promised.")
                continue
            for j in range(3):
                wanted = all(wins(int(t), fewest - 1) for t in step[j, s])
                expect(got[j, s] or not wanted, "an input is missing that leads in any case to fewer steps.")
                expect(
                    wanted or not got[j, s],
                    "an input is promised that the adversary can make useless, or that makes no progress.",
                )


@exercise("7.4", "kept = kept and some input leads into kept in any case; over when a round takes nothing away.")
def check_viable(viable):
    """The greatest fixed point."""
    some = 0
    for seed in range(40):
        step, _, unsafe = _game(seed)
        kept = ~unsafe
        for _ in range(13):
            kept = kept & np.array([any(kept[step[j, s]].all() for j in range(3)) for s in range(12)])
        got = np.asarray(viable(step, unsafe))
        expect(got.shape == (12,), "one answer for each state.")
        expect(~got[unsafe], "an unsafe state is not safe for ever.")
        expect(~(got & ~kept), "some state is called viable that leaves after a few steps. Is one round enough?")
        expect(got == kept, "some state is called lost that can stay: against all v, with one of the inputs.")
        some += kept.any()
    return f"{some} of 40 random games have such states. The library asks the same with target=None."


@exercise(
    "7.5",
    "Find the tubes of `second` first. A state of `first` is as good as the steps left make it, and no better.",
)
def check_in_order(in_order):
    """Played out with a flag for whether the first place has been seen."""
    for seed in range(40):
        step, first, unsafe = _game(seed)
        second = np.roll(first, 3)

        @cache
        def wins(s, seen, n, step=step, first=first, second=second, unsafe=unsafe):
            if unsafe[s]:
                return False
            seen = seen or bool(first[s])
            if seen and second[s]:
                return True
            return n > 0 and any(all(wins(t, seen, n - 1) for t in moves) for moves in step[:, s].tolist())

        most = (0, 1, 2, 5)[seed % 4]
        wanted = np.array([wins(s, False, most) for s in range(12)])
        got = np.asarray(in_order(step, first, second, unsafe, most))
        expect(got.shape == (12,), "one answer for each state.")
        expect(
            ~(got & ~wanted), "some state is called won where the steps do not last for both, or the order is wrong."
        )
        expect(
            got == wanted, "some state is called lost that wins. May the first place be seen early, and passed again?"
        )
    return "It is Theorem 2 on states with a flag: a product of the game and a small automaton."


def _entries(step, goals, unsafe):
    """Every entry (k, n) of a game whose goal depends on time, by Theorem 2."""
    last = len(goals) - 1
    entries = {(k, 0): goals[k] & ~unsafe for k in range(last + 1)}
    for k in range(last - 1, -1, -1):
        for n in range(1, last - k + 1):
            leads = entries[k + 1, n - 1][step].all(axis=2).any(axis=0)
            entries[k, n] = entries[k, n - 1] | (leads & ~unsafe)
    return entries


@exercise(
    "7.6",
    "For n = 1 there is no second entry to look at in the row below. And what row k has done so far says nothing about "
    "what it will do.",
)
def check_pausing(settled, pausing):
    """Entry (k, n) equals (k, n - 1) where (k + 1, n - 1) equals (k + 1, n - 2); a row that pauses and grows again."""
    for seed in range(60):
        step, goal, unsafe = _game(seed)
        rng = np.random.default_rng(seed)
        goals = goal & (rng.random((5, 1)) < 0.4)  # there at some steps only
        entries = _entries(step, goals, unsafe)
        for k, n in ((start, within) for start in range(3, -1, -1) for within in range(1, 5 - start)):
            known = {at: entry for at, entry in entries.items() if at[0] > k or (at[0] == k and at[1] < n)}
            got = bool(settled(known, k, n))
            same = np.array_equal(entries[k, n], entries[k, n - 1])
            where = f"entry ({k}, {n}) of a game with goals at some steps only"
            expect(
                same or not got, f"{where}: you say that it is settled, and it grows. Is it the row below that tells?"
            )
            told = n >= 2 and np.array_equal(entries[k + 1, n - 1], entries[k + 1, n - 2])
            expect(got or not told, f"{where}: the two entries below are equal, so nothing new can come from there.")
    step, goals, unsafe = map(np.asarray, pausing)
    m = len(unsafe)
    expect(step.ndim == 3 and step.shape[1] == m and goals.shape == (5, m), "step (inputs, m, moves), goals (5, m).")
    expect((step >= 0) & (step < m), "every move leads to one of the states 0 to m - 1.")
    entries = _entries(step, goals.astype(bool), unsafe.astype(bool))
    grows = [not np.array_equal(entries[0, n], entries[0, n - 1]) for n in range(1, 5)]
    expect(any(grows), "row 0 never grows. Is the goal there at a step that it can be reached at?")
    last = 4 - grows[::-1].index(True)
    expect(not all(grows[:last]), "row 0 grows at every column until it ends. When is the goal there?")
    return "Row 0 holds " + ", ".join(str(int(entries[0, n].sum())) for n in range(5)) + " states."
