"""What the plain checker says of a file."""

from forged_robots import ROBOTS

from sdhj.certified.check import argument, reading


def refusals(path, beside=None, every=True, of=argument):
    """Yield what the plain checker says against a file: a text for each claim not proved, or one sentence."""
    try:
        with reading.head_and_arrays(path) as (told, arrays):
            for claim in of.Argument(told, arrays, beside).claims(every):
                if claim.failed:
                    yield str(claim)
    except ValueError as error:
        yield str(error)


def box_beside(name):
    return ROBOTS[name][0]() if name.startswith("hidden") else None
