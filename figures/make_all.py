"""Every figure, one after the other; what they share is solved once."""

from common import command, write_all

if __name__ == "__main__":
    command("Every figure", lambda context, out: write_all(context, out))()
