"""Normally distributed points that fill the space evenly, always the same.

A scrambled Halton sequence through the inverse of the normal distribution, to the last bit that of
`scipy.stats.qmc.MultivariateNormalQMC`, which takes half a second to load.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import count, islice

import numpy as np

from ff_planner_ros.common.arrays import Array

# No coordinate is nearer to 0 or 1 before the inverse of the distribution, which is infinite there.
_INSIDE = 1.0 - 1e-10
# Of ndtri in Cephes (NOTICE): rational approximations of the middle and of the tails, which meet at
# this probability; coefficients of the highest power first.
_TAIL, _ROOT_OF_TWO_PI = math.exp(-2.0), 2.5066282746310007
_MIDDLE = (
    (
        *(-59.96335010141079, 98.00107541859997, -56.67628574690703, 13.931260938727968),
        -1.2391658386738125,
    ),
    (
        *(1.0, 1.9544885833814176, 4.676279128988815, 86.36024213908905, -225.46268785411937),
        *(200.26021238006066, -82.03722561683334, 15.90562251262117, -1.1833162112133),
    ),
)
_TAILS = (
    (
        *(4.0554489230596245, 31.525109459989388, 57.16281922464213, 44.08050738932008),
        *(14.684956192885803, 2.1866330685079025, -0.1402560791713545, -0.03504246268278482),
        -0.0008574567851546854,
    ),
    (
        *(1.0, 15.779988325646675, 45.39076351288792, 41.3172038254672, 15.04253856929075),
        *(2.504649462083094, -0.14218292285478779, -0.03808064076915783, -0.0009332594808954574),
    ),
)


def even_normals(components: int) -> Iterator[Array]:
    """Yield points of independent standard normal components without end. Shape (components,)."""
    (random,) = np.random.default_rng(0).spawn(1)
    bases = list(islice(_primes(), components))
    digits = [_permuted_digits(base, random) for base in bases]
    for number in count():
        inside = [_digits_reversed(number, *one) for one in zip(bases, digits, strict=True)]
        yield np.array([_normal_quantile(0.5 + _INSIDE * (one - 0.5)) for one in inside])


def _primes() -> Iterator[int]:
    for number in count(2):
        if all(number % smaller for smaller in range(2, math.isqrt(number) + 1)):
            yield number


def _permuted_digits(base: int, random: np.random.Generator) -> list[list[int]]:
    """Return a permutation of the digits of a base for each place that a number of 54 bits has."""
    permutations = np.repeat(np.arange(base)[None], math.ceil(54 / math.log2(base)) - 1, axis=0)
    for one in permutations:
        random.shuffle(one)
    found: list[list[int]] = permutations.tolist()
    return found


def _digits_reversed(number: int, base: int, permutations: list[list[int]]) -> float:
    """Return the fraction of permuted digits of a number, the last digit first (van der Corput)."""
    fraction, weight = 0.0, 1.0 / base
    for permutation in permutations:
        number, digit = divmod(number, base)
        fraction += permutation[digit] * weight
        weight /= base
    return fraction


def _normal_quantile(probability: float) -> float:
    """Return the standard normal number that a random one is below with some probability."""
    tail = min(probability, 1.0 - probability)
    if tail > _TAIL:
        y = probability - 0.5
        return (y + y * _times_ratio(y * y, _MIDDLE)) * _ROOT_OF_TWO_PI
    x = math.sqrt(-2.0 * math.log(tail))
    distance = x - math.log(x) / x - _times_ratio(1.0 / x, _TAILS)
    return math.copysign(distance, probability - 0.5)


def _times_ratio(x: float, polynomials: tuple[tuple[float, ...], tuple[float, ...]]) -> float:
    """Return x times the ratio of two polynomials of it."""
    above, below = (_polynomial(one, x) for one in polynomials)
    return x * above / below


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    value = 0.0
    for one in coefficients:
        value = value * x + one
    return value
