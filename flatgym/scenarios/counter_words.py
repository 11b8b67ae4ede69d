"""The generator of `flatgym.scenarios.counter_rng` on pairs of 32-bit words, for PyTorch and JAX.

PyTorch has no arithmetic of unsigned 64-bit integers, and JAX has none unless it is switched on. A 64-bit number is
therefore a pair (high, low) of words below 2^32, in arrays of any integer type of 32 unsigned or 64 bits. The numbers
are those of `counter_rng`: equal in float64, rounded in float32.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.arrays import library, namespace
from flatgym.scenarios import counter_rng

Words = tuple[Any, Any]
"""The high and the low word of 64-bit numbers, each shape (n,)."""
MASK, HALF = 2**32 - 1, 2**16 - 1


def words(seed: Any, xp: Any, device: Any = None) -> Words:
    """Return whole numbers in 0..2^64 - 1, as NumPy takes them, in words of PyTorch or JAX."""
    numbers = np.atleast_1d(np.asarray(seed, dtype=np.uint64))
    parts = numbers >> np.uint64(32), numbers & np.uint64(MASK)
    if xp.__name__ == "jax.numpy":
        high, low = (xp.asarray(part.astype(np.uint32)) for part in parts)
    else:
        high, low = (xp.asarray(part.astype(np.int64), device=device) for part in parts)
    return high, low


def halves(numbers: Any) -> Words:
    """Return the words of 64-bit integers in an array of PyTorch."""
    return numbers >> 32 & MASK, numbers & MASK


def split(number: Any, word: Any) -> Words:
    """Return the high and the low word of a constant, fit for arithmetic with `word`."""
    high, low = int(number) >> 32 & MASK, int(number) & MASK
    return (np.uint32(high), np.uint32(low)) if library(word) == "jax" else (high, low)


def cut(word: Any) -> Any:
    """Return a word modulo 2^32; arrays of 32 bits are."""
    return word if word.dtype.itemsize == 4 else word & MASK


def add(a: Words, b: Words) -> Words:
    """Return the sum modulo 2^64."""
    low = cut(a[1] + b[1])
    return cut(a[0] + b[0] + namespace(low).astype(low < b[1], low.dtype)), low


def multiply(a: Words, b: Words) -> Words:
    """Return the product modulo 2^64, from products of 16-bit halves, which fit into 32 bits."""
    (high, low), (b_high, b_low) = a, b
    a0, a1, b0, b1 = low & HALF, low >> 16, b_low & HALF, b_low >> 16
    right, left, cross = a0 * b0, a0 * b1, a1 * b0
    middle = (right >> 16) + (left & HALF) + (cross & HALF)
    top = a1 * b1 + (left >> 16) + (cross >> 16) + (middle >> 16)
    return cut(top + low * b_high + high * b_low), (right & HALF) | cut(middle << 16)


def xor_shifted(a: Words, bits: int) -> Words:
    """Return x ^ (x >> bits), 0 < bits < 32."""
    high, low = a
    return high ^ (high >> bits), low ^ (low >> bits) ^ cut(high << (32 - bits))


def mix(x: Words) -> Words:
    """Return SplitMix64's finalizer of x."""
    x = multiply(xor_shifted(x, int(counter_rng.S30)), split(counter_rng.FIRST, x[1]))
    x = multiply(xor_shifted(x, int(counter_rng.S27)), split(counter_rng.SECOND, x[1]))
    return xor_shifted(x, int(counter_rng.S31))


def uniform(seed: Words, episode: Words, index: Any, dtype: Any) -> Any:
    """Return uniform numbers in [0, 1) for the addresses, shape (n,), in a floating point type.

    Args:
        seed, episode: words of shape (n,).
        index: a whole number, or words of shape (n,).
        dtype: float64 or float32.
    """
    golden, step = (split(number, seed[1]) for number in (counter_rng.GOLDEN, counter_rng.STEP))
    first, second = mix(add(seed, golden)), multiply(episode, golden)
    key = mix((first[0] ^ second[0], first[1] ^ second[1]))
    offset = split(index * int(counter_rng.STEP), seed[1]) if isinstance(index, int) else multiply(index, step)
    high, low = mix(add(key, offset))
    xp = namespace(high)
    number = xp.astype(high, dtype) * 2.0**-32 + xp.astype(low >> 11, dtype) * 2.0**-53
    return xp.clip(number, None, 1 - xp.finfo(dtype).eps / 2)  # float32 would round the largest to 1


def normal(seed: Words, episode: Words, index: Words, dtype: Any) -> Any:
    """Return standard normal numbers from the uniform ones at `index` and `index + 1` (Box and Muller 1958)."""
    xp = namespace(seed[0])
    radius = xp.sqrt(-2 * xp.log1p(-uniform(seed, episode, index, dtype)))
    return radius * xp.cos(2 * np.pi * uniform(seed, episode, add(index, split(1, index[1])), dtype))
