"""Legal level-set functions, (M, 2) -> (M,), that are easily bounded wrongly: views, kinds of numbers, NaN.

Each has to be refused, or bounded truly.
"""

import numpy as np


def caught(p):
    try:
        return np.full(len(p), -1.0 + 0.0 * int(p[0, 0]))
    except TypeError:
        return np.hypot(p[:, 0], p[:, 1]) - 0.5


def caught2(p):
    try:
        return np.asarray(p)[:, 0] - 0.2
    except Exception:
        return p[:, 0] * 0 - 1.0


def view_write(p):
    out = np.zeros_like(p)
    flat = np.reshape(out, -1)
    flat[:] = 3.0
    return out[:, 0] - p[:, 0]


def view_write2(p):
    out = p.copy()
    t = out.T
    t[0] = 2.0
    return out[:, 0] - p[:, 1]


def view_write3(p):
    out = p.copy()
    r = np.ravel(out)
    out[:, 0] = 9.0
    return r[::2] - p[:, 1]


def view_sq(p):
    a = p[:, :1].copy()
    b = np.squeeze(a, axis=1)
    b[:] = 4.0
    return a[:, 0] - p[:, 1]


def swap(p):
    out = p.copy()
    s = np.swapaxes(out, 0, 1)
    s[1] = -s[1]
    return out[:, 1] - 0.2


def pos_alias(p):
    a = p[:, 0].copy()
    b = np.positive(a)
    b[:] = 7.0
    return a - 0.3


def astype_alias(p):
    a = p[:, 0].copy()
    b = a.astype(float)
    b[:] = 7.0
    return a - 0.3


def int_zero(p):
    out = np.zeros_like(p, dtype=int)
    out[:, 0] = 3 * p[:, 0]
    return out[:, 0] + 0.5 - np.abs(p[:, 1])


def like_mask(p):
    out = np.zeros_like(p[:, 0] > 0)
    out[:] = 0.5 * p[:, 0]
    return out * 1.0 - 0.5


def full_int(p):
    return np.full_like(p[:, 0], 0.7, dtype=int) * 1.0 + p[:, 0] - 0.5


FUNCTIONS = {
    "bool_add3": lambda p: 1.5 - ((p[:, 0] > 0) + (p[:, 1] > 0) + (np.abs(p[:, 0]) < 2)),
    "bool_mul_add": lambda p: 0.5 - ((p[:, 0] > -0.5) * (p[:, 1] > -0.5) + (p[:, 0] < 0.5)) + 0.0 * p[:, 0],
    "nan_log": lambda p: np.where(np.log(p[:, 0]) < 5, 1.0, -1.0),
    "nan_sqrt": lambda p: np.where(np.sqrt(p[:, 0]) >= 0, 1.0, -1.0),
    "nan_not": lambda p: np.where(~(np.log(p[:, 0]) > -50), -1.0, 1.0),
    "nan_div": lambda p: np.where((p[:, 0] * 0.0) / (p[:, 0] - p[:, 0]) < 1, 1.0, -1.0),
    "nan_arcsin": lambda p: np.where(np.arcsin(2 * p[:, 0]) < 9, 1.0, -1.0),
    "nan_pow": lambda p: np.where(p[:, 0] ** 0.5 < 9, 1.0, -1.0),
    "nan_max": lambda p: np.maximum(np.sqrt(p[:, 0]), -1.0),
    "nan_min": lambda p: np.minimum(np.sqrt(p[:, 0] - 0.3), -1.0),
    "nan_fmax": lambda p: np.fmax(np.sqrt(p[:, 0]), -1.0),
    "nan_fmin": lambda p: np.fmin(np.sqrt(p[:, 0]), 2.0) - 1.5,
    "nan_eq": lambda p: np.where(np.log(p[:, 0]) == np.log(p[:, 0]), 1.0, -1.0),
    "nan_ne": lambda p: np.where(np.sqrt(p[:, 0]) != np.sqrt(p[:, 0]), -1.0, 1.0),
    "nan_sum": lambda p: np.where(np.sum(np.sqrt(p), axis=1) >= 0, 1.0, -1.0),
    "nan_clip": lambda p: np.clip(np.sqrt(p[:, 0]), 1.0, 2.0),
    "sum_dtype": lambda p: np.sum(p * 3, axis=1, dtype=int) - 0.5,
    "mean_dtype": lambda p: np.mean(p, axis=1, dtype=np.float16) - 0.3,
    "prod_initial": lambda p: np.prod(p, axis=1, initial=-1.0) - 0.3,
    "complex2": lambda p: (p[:, 0] * (1 + 1j) * (1 - 1j)).real - 0.5,
    "complex3": lambda p: np.abs(1j * p[:, 0]) - 0.5,
    "rownorm": lambda p: p[:, 0] / np.linalg.norm(p) - 0.05,
    "flip": lambda p: np.flip(p)[:, 0] - 0.2,
    "cut": lambda p: np.arctan2(-0.0 * np.abs(p[:, 0]), -1.0 - np.abs(p[:, 1])),
    "cut2": lambda p: np.arctan2(p[:, 1] * -0.0, -1.0 - np.abs(p[:, 0])),
    "dtype": lambda p: p[:, 0] - 0.2 if getattr(p, "flags", None) is not None else p[:, 0] * 0 - 1.0,
    "where_out": lambda p: np.multiply(p[:, 0], 2.0, where=p[:, 1] > 0) - 0.2,
    "norm_all": lambda p: np.linalg.norm(p.reshape(-1, 1, 2), axis=(1, 2)) - 0.5,
    "sign_bool": lambda p: np.sign((p[:, 0] > 0) * 1.0) - 0.5,
    "bool_sub": lambda p: 1.0 - (p[:, 0] > 0) - (p[:, 1] > 0),
    "not_of_numbers": lambda p: np.where(np.logical_not(p[:, 0]), -1.0, 1.0),
    "max_nums": lambda p: np.logical_or(p[:, 0] * 3, p[:, 1]) * 1.0 - 0.5,
    "all_num": lambda p: np.all(p * np.array([1.0, 3.0]), axis=1) * 1.0 - 0.5,
    "minreduce_where": lambda p: np.minimum.reduce(p, axis=1, where=[True, False], initial=9.0) - 0.2,
    "inf_mask": lambda p: np.minimum(np.where(p[:, 0] > 0, np.inf, -1.0) * 0.0, 1.0),
    "overflow": lambda p: np.where(np.exp(800 * p[:, 0]) - np.exp(800 * p[:, 0]) < 1, 1.0, -1.0),
    **{
        f.__name__: f
        for f in (caught, caught2, view_write, view_write2, view_write3, view_sq, swap, pos_alias, astype_alias)
    },
    **{f.__name__: f for f in (int_zero, like_mask, full_int)},
    "f32": lambda p: (p[:, 0].astype(np.float32) * np.float32(1e8)) - np.float32(1e8) * p[:, 0] - 1.0,
    "take_mode": lambda p: np.take(p, [3], axis=1, mode="clip")[:, 0] - 0.2,
    "repeat": lambda p: np.repeat(p, 2, axis=1)[:, 1] - p[:, 1],
}
