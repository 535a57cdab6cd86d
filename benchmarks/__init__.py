"""Measurements of springgym, as commands of a clone.

===============  ======================================================================
`speed`          steps a second, errors and start-up time, beside other programs
`accuracy`       error against cost of every integrator
`hard_cases`     cases where simulators break
`top_models`     the cheapest model of a top within an error
===============  ======================================================================

Run one with ``python -m benchmarks.speed``, with ``--help`` for its options. The other modules are what they
share: problems, other programs (`peers`), timing, figures, and the conditions of a measurement.
"""
