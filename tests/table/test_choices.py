"""What may be chosen by name follows from one record each: the command line, docstrings and errors name the same."""

import click
import pytest
from zoo import interval_table

import sdhj
from sdhj import cli
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.solving import METHODS
from sdhj.table.rules import RULES

CHOICES = {"method": METHODS, "adversary": ADVERSARIES, "rule": RULES}


def options(command):
    """The choices (name, values) of a command's options, and of those below it."""
    for option in command.params:
        if isinstance(option.type, click.Choice):
            yield option.name, set(option.type.choices)
    for below in getattr(command, "commands", {}).values():
        yield from options(below)


def test_the_command_line_offers_them():
    found = [(name, choices) for name, choices in options(cli.main) if name in CHOICES]
    assert {name for name, _ in found} == set(CHOICES)
    for name, choices in found:
        assert choices == set(CHOICES[name]) | ({"small"} if name == "rule" else set())  # of tables in C alone


@pytest.mark.parametrize("name", CHOICES)
def test_errors_name_them(name):
    table = interval_table()
    wrong = {
        "method": lambda: sdhj.solve(table.problem, "x"),
        "rule": lambda: sdhj.Controller(table, "x"),
        "adversary": lambda: sdhj.monte_carlo(sdhj.Controller(table), 1, "x"),
    }
    with pytest.raises(ValueError, match=f"{name} .*{', '.join(CHOICES[name])}"):
        wrong[name]()


def test_each_adversary_says_how_it_misleads():
    """None plays another's errors by default."""
    assert all(callable(one.mislead) and callable(one.shift) for one in ADVERSARIES.values())
    assert [name for name, one in ADVERSARIES.items() if one.name != name] == []
