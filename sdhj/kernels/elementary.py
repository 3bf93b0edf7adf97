"""Elementary functions of one float64, the same bits on every processor: no libm, no fused operations, no branches.

Reductions and coefficients are those of fdlibm (Sun Microsystems 1993, netlib.org/fdlibm: k_sin.c, k_cos.c, e_log.c,
s_atan.c, e_asin.c) and, for tanh, of Cephes (S. Moshier 1984, netlib.org/cephes: tanh.c); exp is a Taylor polynomial.
NaN, and what lies outside a domain, gives NaN. `sdhj.formulas.rules` has a bound of each one's error, in units in the
last place. Every loop over these functions vectorises: there are selections in place of branches, and integers are had
from the bits of floats, as conversions are not in every instruction set.
"""

import math

import numpy as np

from sdhj.kernels.compiling import inlined

# Errors: fdlibm and Cephes have less than one unit in the last place each; here what is left out of the second words of
# reduced arguments (1 for sin, cos and pow, 2 for tan and the arcs), and quotients, add to it. Tested exactly.
TURNS = 2.0**26  # quarter turns; sin, cos and tan beyond it are NaN: an argument of 1e8 has lost half its digits
LAPS = 2.0**24  # mod beyond it is NaN: its differences would be rounded
NAN, INF = math.nan, math.inf
ROUND = 1.5 * 2.0**52  # added and subtracted: the nearest whole number, which is then in the last bits of the sum
ROUND_BITS = int(np.float64(ROUND).view(np.int64))
WHOLE_BITS = int(np.float64(2.0**52).view(np.int64))
ONE_BITS = int(np.float64(1.0).view(np.int64))
EXPONENT = 0x7FF << 52
FRACTION = (1 << 52) - 1
HEAD = ~((1 << 27) - 1)  # the first 26 bits of a fraction
ROOT_BITS = int(np.float64(math.sqrt(0.5)).view(np.int64))
# pi/2 in parts: of the first four, 27 bits each, a product with a whole number up to TURNS is exact
P1, P2, P3, P4, P5 = (
    float.fromhex(part)
    for part in ("0x1.921fb54p+0", "0x1.10b461p-30", "0x1.a62633p-58", "0x1.45c06ep-86", "0x1.cd129024e088ap-115")
)
QUARTERS = 0.63661977236758134308  # in a radian
LOG2E = 1.44269504088896338700
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # the first has 33 bits
QUARTER_LOW, HALF_PI, PI = 3.06161699786838301793e-17, math.pi / 2, math.pi
HALF_PI_LOW, PI_LOW = 6.12323399573676603587e-17, 1.22464679914735317720e-16
TWO_THIRDS, TWO_THIRDS_LOW = 2 / 3, 2.0**-54 * 2 / 3


@inlined
def _reduced(x):
    """x less whole quarter turns: (r, bits), r in [-pi/4, pi/4], bits an int64 whose last bits count these turns.

    Each difference is exact or of the size of its larger operand, so the relative error stays small at zeros, too.
    """
    bits = x * QUARTERS + ROUND
    k = bits - ROUND
    k = k if abs(k) <= TURNS else NAN
    return ((((x - k * P1) - k * P2) - k * P3) - k * P4) - k * P5, np.float64(bits).view(np.int64)


@inlined
def _sine(r):
    """sin(r) for |r| <= pi/4, by fdlibm's polynomial."""
    z = r * r
    tail = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    return r + r * z * (-1.66666666666666324348e-01 + z * tail)


@inlined
def _cosine(r):
    """cos(r) for |r| <= pi/4, by fdlibm's polynomial."""
    z = r * r
    tail = -1.38888888888741095749e-03 + z * (
        2.48015872894767294178e-05
        + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))
    )
    return 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * tail))


@inlined
def sine(x, quarter_turns):
    """sin(x + quarter_turns pi/2), quarter_turns whole: the sine for 0, the cosine for 1. NaN beyond TURNS."""
    r, quarter = _reduced(x)
    quarter += quarter_turns
    value = _cosine(r) if quarter & 1 else _sine(r)
    return -value if quarter & 2 else value


@inlined
def tan(x):
    """sin(r) / cos(r), or -cos(r) / sin(r) in odd quarter turns, for r of `_reduced`. NaN beyond TURNS."""
    r, quarter = _reduced(x)
    s, c = _sine(r), _cosine(r)
    return (-c if quarter & 1 else s) / (s if quarter & 1 else c)


@inlined
def _power_of_two(exponent):
    """2^exponent for an int64 exponent from -1022 to 1023, by its bits."""
    return np.int64((exponent + 1023) << 52).view(np.float64)


@inlined
def _exp(x, low):
    """exp(x + low), |low| at most about a unit in the last place of x: 2^k e^r, e^r by a Taylor polynomial."""
    x = -750.0 if x < -750.0 else x
    x = 710.0 if x > 710.0 else x  # infinite in the end
    bits = x * LOG2E + ROUND
    k = bits - ROUND
    r = (x - k * LN2_HIGH) - (k * LN2_LOW - low)
    tail = 1 / 5040 + r * (
        1 / 40320
        + r * (1 / 362880 + r * (1 / 3628800 + r * (1 / 39916800 + r * (1 / 479001600 + r * (1 / 6227020800)))))
    )
    value = 1.0 + (r + r * r * (0.5 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (1 / 720 + r * tail))))))
    half = 0.5 * k + ROUND  # two factors: the power of two may be no float where its product with the value is one
    k_bits, half_bits = np.float64(bits).view(np.int64) - ROUND_BITS, np.float64(half).view(np.int64) - ROUND_BITS
    return value * _power_of_two(half_bits) * _power_of_two(k_bits - half_bits)


@inlined
def exp(x):
    """e^x: 0 far below 0, infinity where it overflows, NaN for NaN."""
    return _exp(x, 0.0)


@inlined
def _split(x):
    """(k, f), two floats, of x = 2^k (1 + f) with 1 + f from sqrt(1/2) to sqrt(2), for x > 0 and finite."""
    small = x < 2.0**-1022
    # the exponent of this sum of bits is that of 2^k, and its fraction plus ROOT_BITS are the bits of 1 + f
    bits = np.float64(x * 2.0**54 if small else x).view(np.int64) + (ONE_BITS - ROOT_BITS)
    k = np.int64(np.int64(np.uint64(bits) >> np.uint64(52)) | WHOLE_BITS).view(np.float64) - (2.0**52 + 1023)
    return (k - 54.0 if small else k), np.int64((bits & FRACTION) + ROOT_BITS).view(np.float64) - 1.0


@inlined
def log(x):
    """k ln 2 + log(1 + f), by fdlibm's polynomial in s = f / (2 + f). NaN for x <= 0."""
    k, f = _split(x)
    s = f / (2.0 + f)
    z = s * s
    tail = 2.222219843214978396e-01 + z * (
        1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01)
    )
    rest = z * (6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * tail)))
    half = 0.5 * f * f
    value = k * LN2_HIGH - ((half - (s * (half + rest) + k * LN2_LOW)) - f)
    value = value if x < INF else x
    return value if x > 0.0 else NAN


@inlined
def _product(a, b):
    """(p, rest): the product a b as the exact sum of two floats (Dekker 1971), for numbers of moderate size."""
    p, wide_a, wide_b = a * b, a * 134217729.0, b * 134217729.0
    head_a, head_b = wide_a - (wide_a - a), wide_b - (wide_b - b)
    tail_a, tail_b = a - head_a, b - head_b
    return p, ((head_a * head_b - p) + head_a * tail_b + tail_a * head_b) + tail_a * tail_b


@inlined
def _long_log(x):
    """(high, low): log(x) as the sum of two floats, to 62 bits, for x > 0 and finite.

    2 artanh(s), s = f / (2 + f) and the first two terms of the series 2 (s + s^3/3 + s^5/5 ...) as two floats.
    """
    k, f = _split(x)
    t = 1.0 + (1.0 + f)
    s = f / t
    p, p_low = _product(s, t)
    s_low = (((f - p) - p_low) - s * (f - (t - 2.0))) / t
    z, z_low = _product(s, s)
    tail = 2 / 13 + z * (2 / 15 + z * (2 / 17 + z * (2 / 19 + z * (2 / 21 + z * (2 / 23 + z * (2 / 25))))))
    rest = z * z * (2 / 5 + z * (2 / 7 + z * (2 / 9 + z * (2 / 11 + z * tail))))
    p, p_low = _product(z, TWO_THIRDS)
    q, q_low = _product(s, p)
    q_low += s * (p_low + (z_low * TWO_THIRDS + (z * TWO_THIRDS_LOW + rest)))
    first = k * LN2_HIGH + 2.0 * s
    second = first + q
    low = 2.0 * s - (first - k * LN2_HIGH) + (q - (second - first))
    return second, low + (q_low + (2.0 * s_low + 6.0 * (s_low * z) / 3.0 + k * LN2_LOW))


@inlined
def pow(a, b):
    """a^b = exp(b log(a)) for a > 0, or 0 for a = 0 and b > 0; NaN elsewhere."""
    high, low = _long_log(a)
    much = 2.0**80  # with it every power but of 1 is 0 or infinite
    b = much if b > much else b
    b = -much if b < -much else b
    y, y_low = _product(high, b)
    y_low = y_low + b * low if abs(y) < 1000.0 else 0.0
    value = _exp(y, y_low)
    value = 0.0 if (a == 0.0) & (b > 0.0) else value
    return value if (a > 0.0) & (a < INF) | (a == 0.0) & (b > 0.0) else NAN


@inlined
def _artan(p, q):
    """(high, low): arctan(p / q) as the sum of two floats, for p, q >= 0, not both 0 and not both infinite."""
    x = p / q
    kind = (1.0 if x > 7 / 16 else 0.0) + (1.0 if x > 11 / 16 else 0.0) + (1.0 if x > 19 / 16 else 0.0)
    c = 0.5 * kind
    t = (x - c) / (1.0 + c * x)
    steep = x > 39 / 16
    t = -q / p if steep else t
    high = 4.63647609000806093515e-01 if kind == 1.0 else (7.85398163397448278999e-01 if kind == 2.0 else 0.0)
    low = 2.26987774529616870924e-17 if kind == 1.0 else (QUARTER_LOW if kind == 2.0 else 0.0)
    high = 9.82793723247329054082e-01 if kind == 3.0 else high
    low = 1.39033110312309984516e-17 if kind == 3.0 else low
    high, low = HALF_PI if steep else high, HALF_PI_LOW if steep else low
    z = t * t
    tail = 4.97687799461593236017e-02 + z * (-3.65315727442169155270e-02 + z * 1.62858201153657823623e-02)
    tail = 6.66107313738753120669e-02 + z * (-5.83357013379057348645e-02 + z * tail)
    tail = 9.09088713343650656196e-02 + z * (-7.69187620504482999495e-02 + z * tail)
    tail = 1.42857142725034663711e-01 + z * (-1.11111104054623557880e-01 + z * tail)
    tail = z * (3.33333333333329318027e-01 + z * (-1.99999999998764832476e-01 + z * tail))
    rest = low - t * tail
    total = high + t  # the larger first, so the next line is exact
    return total, (t - (total - high)) + rest


@inlined
def arctan(x):
    """arctan(x) in [-pi/2, pi/2]: that of |x| as the sum of two floats, with the sign of x."""
    high, low = _artan(abs(x), 1.0)
    value = high + low
    return -value if x < 0.0 else value


@inlined
def arctan2(y, x):
    """The angle of the point (x, y), from -pi to pi; the sign of a zero counts as in NumPy."""
    high, low = _artan(abs(y), abs(x))
    origin = (y == 0.0) & (x == 0.0)
    high, low = 0.0 if origin else high, 0.0 if origin else low
    value = (PI - high) + (PI_LOW - low) if np.float64(x).view(np.int64) < 0 else high + low
    return -value if np.float64(y).view(np.int64) < 0 else value


@inlined
def tanh(x):
    """tanh(x): x + x^3 p(x^2) / q(x^2) for small |x| (Cephes), else 1 - 2 / (e^(2 |x|) + 1) with its sign."""
    z = x * x
    p = (-9.64399179425052238628e-1 * z - 9.92877231001918586564e1) * z - 1.61468768441708447952e3
    q = ((z + 1.12811678491632931402e2) * z + 2.23548839060100448583e3) * z + 4.84406305325125486048e3
    small = x + x * z * (p / q)
    large = 1.0 - 2.0 / (_exp(2.0 * abs(x), 0.0) + 1.0)
    return small if abs(x) < 0.625 else (-large if x < 0.0 else large)


@inlined
def _arc(z):
    """(arcsin(s) - s) / s for z = s^2 <= 1/4, by fdlibm's rational function of z."""
    p = 2.01212532134862925881e-01 + z * (
        -4.00555345006794114027e-02 + z * (7.91534994289814532176e-04 + z * 3.47933107596021167570e-05)
    )
    q = 2.02094576023350569471e00 + z * (-6.88283971605453293030e-01 + z * 7.70381505559019352791e-02)
    top = z * (1.66666666666666657415e-01 + z * (-3.25565818622400915405e-01 + z * p))
    return top / (1.0 + z * (-2.40339491173441421878e00 + z * q))


@inlined
def arcsin(x):
    """arcsin(x), by a rational function; pi/2 - 2 arcsin(sqrt((1 - |x|) / 2)) for |x| > 1/2. NaN for |x| > 1."""
    size = abs(x)
    large = size > 0.5
    z = 0.5 * (1.0 - size) if large else x * x
    s = math.sqrt(z) if large else size
    value = s + s * _arc(z)
    value = HALF_PI - (2.0 * value - HALF_PI_LOW) if large else value
    return -value if x < 0.0 else value


@inlined
def arccos(x):
    """arccos(x) = pi/2 - arcsin(x), by half angles for |x| > 1/2. NaN for |x| > 1."""
    size = abs(x)
    large = size > 0.5
    z = 0.5 * (1.0 - size) if large else x * x
    s = math.sqrt(z) if large else x
    value = s + s * _arc(z)
    near = PI - (2.0 * value - PI_LOW) if x < 0.0 else 2.0 * value
    return near if large else HALF_PI - (value - HALF_PI_LOW)


@inlined
def hypot(a, b):
    """sqrt(a^2 + b^2), computed of numbers scaled by a power of two, so that squares do not overflow."""
    a, b = abs(a), abs(b)
    size = a if a > b else b
    size = size if size > 2.0**-1000 else 2.0**-1000
    size = size if size < 2.0**1000 else 2.0**1000  # infinity and what is near it needs no more
    power = np.float64(size).view(np.int64) & EXPONENT
    up, down = np.int64(power).view(np.float64), np.int64((2046 << 52) - power).view(np.float64)
    a, b = a * down, b * down
    return math.sqrt(a * a + b * b) * up


@inlined
def mod(a, b):
    """a - floor(a / b) b, rounded once; it has the sign of b. NaN for b = 0 and for more than LAPS laps, |a / b|."""
    laps = (a / b + ROUND) - ROUND  # the nearest, so that both differences below are exact
    head = np.int64(np.float64(b).view(np.int64) & HEAD).view(np.float64)
    rest = (a - laps * head) - laps * (b - head)
    rest = rest + b if (rest < 0.0) & (b > 0.0) | (rest > 0.0) & (b < 0.0) else rest
    return rest if abs(laps) <= LAPS else NAN
