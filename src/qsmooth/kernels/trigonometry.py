"""Angles in lanes: arctangents, sines and cosines without calls, which stop vectorisation.

The polynomials are those of FreeBSD's msun (Sun Microsystems, 1993), good to less than one unit in
the last place on the ranges to which the arguments are brought here.
"""

import math

from qsmooth.kernels._jit import lane_helper

# tan(π/8): beyond it an arctangent is taken of (t - 1) / (t + 1), and π/4 added.
TAN_EIGHTH = math.sqrt(2.0) - 1.0
HALF_PI, QUARTER_PI = 0.5 * math.pi, 0.25 * math.pi


@lane_helper()
def _arctangent(t: float) -> float:
    """Arctangent of what is between -7/16 and 7/16."""
    z = t * t
    w = z * z
    even = z * (
        3.33333333333329318027e-01
        + w
        * (
            1.42857142725034663711e-01
            + w
            * (
                9.09088713343650656196e-02
                + w
                * (
                    6.66107313738753120669e-02
                    + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)
                )
            )
        )
    )
    odd = w * (
        -1.99999999998764832476e-01
        + w
        * (
            -1.11111104054623557880e-01
            + w
            * (
                -7.69187620504482999495e-02
                + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02)
            )
        )
    )
    return t - t * (even + odd)


@lane_helper()
def arctangent(y: float, x: float) -> float:
    """Angle of the vector (x, y), in (-π, π]; 0 for one of no length."""
    ax, ay = abs(x), abs(y)
    small, large = (ay, ax) if ay < ax else (ax, ay)
    steep = small > TAN_EIGHTH * large
    above = small - large if steep else small
    below = small + large if steep else large
    below = below if large > 0.0 else 1.0
    angle = _arctangent(above / below) + (QUARTER_PI if steep else 0.0)
    angle = HALF_PI - angle if ay > ax else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@lane_helper()
def cosine_and_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle between -π/2 and π/2, by those of its half."""
    h = 0.5 * angle
    z = h * h
    of_sine = z * (
        8.33333333332248946124e-03
        + z
        * (
            -1.98412698298579493134e-04
            + z
            * (
                2.75573137070700676789e-06
                + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
            )
        )
    )
    of_cosine = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z
                * (
                    -2.75573143513906633035e-07
                    + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                )
            )
        )
    )
    sine = h + h * z * (-1.66666666666666324348e-01 + of_sine)
    cosine = 1.0 - (0.5 * z - z * of_cosine)
    return 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine
