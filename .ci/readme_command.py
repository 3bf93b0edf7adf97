"""Print a command of the README, so that what the README says is what is tested.

Usage: python readme_command.py README.md "main job"

The command is the one line of the bash block directly below the comment <!-- main job -->.
"""

import re
import sys
from pathlib import Path


def readme_command(text: str, mark: str) -> str:
    """Return the command marked by `<!-- mark -->`; a ValueError says what the README lacks."""
    blocks = re.findall(rf"^<!-- {re.escape(mark)} -->\n```bash\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL)
    if len(blocks) != 1:
        raise ValueError(f"expected one bash block directly below <!-- {mark} -->, found {len(blocks)}")
    command: str = blocks[0].strip()
    if not command or "\n" in command:
        raise ValueError(f"the block below <!-- {mark} --> must be one line, got {command!r}")
    return command


if __name__ == "__main__":
    try:
        print(readme_command(Path(sys.argv[1]).read_text(encoding="utf-8"), sys.argv[2]))
    except (OSError, ValueError) as error:
        sys.exit(f"{sys.argv[1]}: {error}")
