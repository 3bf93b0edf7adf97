"""Slow twins of sdhj.arm.workspace and of the case studies' level sets: plain loops, nothing of sdhj."""

import math


def position(path, t):
    """Centre at time t of a path given as a plain dictionary."""
    if path["kind"] == "still":
        return tuple(path["centre"])
    if path["kind"] == "line":
        return (path["start"][0] + t * path["velocity"][0], path["start"][1] + t * path["velocity"][1])
    angle = path["rate"] * t + path["phase"]
    return (path["centre"][0] + path["radius"] * math.cos(angle), path["centre"][1] + path["radius"] * math.sin(angle))


def joints(q1, q2, l1, l2, kinematics):
    """Elbow and tip of the arm."""
    elbow = (l1 * math.cos(q1), l1 * math.sin(q1))
    if kinematics == "relative":
        return elbow, (elbow[0] + l2 * math.cos(q1 + q2), elbow[1] + l2 * math.sin(q1 + q2))
    return elbow, (l1 * math.cos(q1) + (l1 + l2) * math.cos(q2), l1 * math.sin(q1) + (l1 + l2) * math.sin(q2))


def point_segment(p, a, b):
    """Distance of a point to a segment by cases: before its start, after its end, or beside it."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
    length = math.hypot(ux, uy)
    if length == 0.0 or ux * vx + uy * vy <= 0.0:
        return math.dist(p, a)
    if ux * (p[0] - b[0]) + uy * (p[1] - b[1]) >= 0.0:
        return math.dist(p, b)
    return abs(ux * vy - uy * vx) / length


def arm_distance(q1, q2, point, l1, l2, kinematics):
    """Distance of a point to the skeleton of the arm."""
    elbow, tip = joints(q1, q2, l1, l2, kinematics)
    return min(point_segment(point, (0.0, 0.0), elbow), point_segment(point, elbow, tip))


def sampled_distance(a, b, path, t0, t1, samples):
    """The least distance of the segment a-b to `samples` positions on the path, both ends included."""
    least = math.inf
    for i in range(samples):
        t = t0 + (t1 - t0) * i / (samples - 1)
        least = min(least, point_segment(position(path, t), a, b))
    return least


def unsafe(q1, q2, obstacles, t, l1, l2, half_width, kinematics):
    """Level-set function of the known obstacles (plain dictionaries) at time t."""
    least = math.inf
    for disk in obstacles:
        centre = position(disk["path"], t)
        least = min(least, arm_distance(q1, q2, centre, l1, l2, kinematics) - disk["radius"] - half_width)
    return least
