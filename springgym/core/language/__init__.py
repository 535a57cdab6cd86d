"""A small language of SIMD values on Numba: numbers of many environments, vectors, blocks.

- `lanes`: one number per copy, its operators and functions;
- `memory`: arrays of them;
- `vec`, `vectors`: three numbers as one value;
- `bodies`, `ragged`: the values of several bodies;
- `blocks`, `kinds`: arrays of a batch in Python, and names for annotations.
"""
