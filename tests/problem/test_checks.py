"""Numbers that users give."""

import math

import numpy as np
import pytest

from sdhj.common.checks import number, pair, whole


@pytest.mark.parametrize("value", [3, 3.0, np.int8(3), np.float32(3)])
def test_what_fits_is_converted(value):
    assert number("x", value, least=3, most=3) == 3.0 and type(number("x", value)) is float
    assert whole("x", value, least=3, most=3) == 3 and type(whole("x", value, least=0)) is int
    assert pair("x", [value, value]) == (3.0, 3.0)


@pytest.mark.parametrize(
    ("value", "options", "named"),
    [
        ("0.1", {}, "x.*number.*'0.1'"),
        (None, {}, "x.*number.*None"),
        (True, {}, "x.*number.*True"),
        (np.True_, {}, "x.*number.*"),
        (np.datetime64(3, "D"), {}, "x.*number.*datetime64"),
        (math.nan, {}, "x.*finite.*nan"),
        (-math.inf, {}, "x.*finite.*-inf"),
        (10**400, {}, r"x.*1e308.*1000+\.\.\.000+$"),
        (-0.1, {"least": 0.0}, "x.* 0.*-0.1"),
        (0, {"above": 0.0}, "x.* 0.* 0"),
        (2.5, {"most": 2.0}, "x.* 2.*2.5"),
    ],
)
def test_what_is_no_number_or_out_of_range_is_named(value, options, named):
    with pytest.raises(ValueError, match=f"^{named}") as raised:
        number("x", value, **options)
    assert len(str(raised.value)) < 120


@pytest.mark.parametrize("value", ["3", None, True, 2.5, math.nan, math.inf, 1, 2001, 10**400])
def test_what_is_no_whole_number_or_out_of_range_is_named(value):
    with pytest.raises(ValueError, match="2 to 2,000") as raised:
        whole("x", value, least=2, most=2000)
    assert len(str(raised.value)) < 120
    if value != 2001 and value != 10**400:
        with pytest.raises(ValueError, match="at least 2"):
            whole("x", value, least=2)


@pytest.mark.parametrize("value", [1.0, [1.0], [1.0, 2.0, 3.0], [1.0, [2.0]], "ab"])
def test_what_is_no_pair_is_named(value):
    with pytest.raises(ValueError, match="two numbers"):
        pair("x", value)
