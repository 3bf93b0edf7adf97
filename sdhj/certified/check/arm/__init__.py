"""The claims of the file of an arm, checked by a geometry of its own, which is compiled: of no other robot is it used.

1.  *The cells cover the axes*, in fractions; the period of an angle is an interval that holds 2 pi. (`uncovered`)
2.  *Sets grow*: S_k^{n-1} is a part of S_k^n, so that `within` means what it says. (`cells_added`)
3.  *Reach*: under some input everything that a new cell of S_k^n can lead to lies in cells of S_{k+1}^{n-1}. The cells
    of an axis that the image of a cell may overlap are worked out in fractions (`overlapped`), and the product of the
    four lists has to be in the set. Along the agent's axes each block of the file's pool is eroded once (`erode`);
    along the joints' axes eroded blocks are intersected (`reaching`).
4.  *Clearance*: under the same input the arm meets neither the pursuer nor a known obstacle at any time of the closed
    interval. A link and a disk, or a cell of the pursuer grown by what it can move, are further apart than r if along
    some unit vector n every point of the body is more than r ahead of every point of the link. How far a link extends
    along n is bounded for all joint angles of a box at once (`farthest`). For all of the pursuer's cells in a row some
    directions are tried, and each proves a half plane of cells (`sweep`). Those that are left are asked about one by
    one; where one direction does not do, time, angles and cell are halved (`link_clear`).
5.  *Goals*: the cells of S_k^0 are inside the target at t_k (`tip_inside`), and clear of everything at that instant.
6.  *Rounding* is bounded once for all numbers that are let in (`separation`), and a state counts as in a cell up to
    1e-10 from it (`moved`), in metres and radians.
7.  *The file* describes what its recipe makes (`recipe`).

A cell whose certificate is right may, in principle, need more halving than is granted.
"""
