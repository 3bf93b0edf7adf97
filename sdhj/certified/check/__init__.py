"""An independent check of certified sets: reads a file and derives its claims anew.

Nothing of the solver is used, neither its code nor its bounds: only the numbers in the file. What is proved, and how:

1.  *The cells cover the axes*, in fractions; the period of an angle is an interval that holds 2 pi. (`cells_cover`)
2.  *Sets grow*: S_k^{n-1} is a part of S_k^n, so that `within` means what it says. (`counted`)
3.  *Reach*: under some input everything that a new cell of S_k^n can lead to lies in cells of S_{k+1}^{n-1}. The cells
    of an axis that the image of a cell may overlap are worked out in fractions, walls included (`overlapped`), and the
    whole product of the four lists has to be in the set. Along the agent's axes that product stays in one block of the
    file's pool, so each block is eroded once (`erode`); along the joints' axes eroded blocks are intersected
    (`reaching`).
4.  *Clearance*: under the same input the arm meets neither the pursuer nor a known obstacle at any time of the closed
    interval. A link and a disk, or a cell of the pursuer grown by what it can move, are further apart than r if along
    some unit vector n every point of the body is more than r ahead of every point of the link. How far a link extends
    along n is bounded for all joint angles of a box at once (`farthest`). For all of the pursuer's cells in a row some
    directions are tried in every part of the interval, and each proves a half plane of cells (`sweep`). The cells that
    this leaves are asked about one by one, each with a direction of its own; where one direction does not do, time,
    angles and cell are halved (`link_clear`).
5.  *Goals*: the cells of S_k^0 are inside the target at t_k (`tip_inside`), and clear of everything at that instant.
6.  *Rounding* is bounded once for all numbers that are let in (`separation`), and a state counts as in a cell up to
    1e-10 from it (`moved`).

A row is the cells of the agent for one pair of joint cells; it is checked with all its claims, for all starts, steps
and inputs. The answer is "proved" or "not proved". A cell whose certificate is right may, in principle, need more
halving than is granted.

For a robot of one's own, whose functions are in the file as text: `sdhj.certified.check.robots`, with a reader of
`formulas` and `intervals` of its own.

From the command line: `python -m sdhj.certified.check table.h5`, or `sdhj verify table.h5`, with `--problem
module:function` where the robot has black boxes.
"""

from sdhj.certified.check.claims import Claim, Verdict, verify

__all__ = ["Claim", "Verdict", "verify"]
