"""The compiler: functions of the language become machine code, which is kept on disk.

- `decorators`: what a compiled function carries, and calls of kernels;
- `targets`: the processors that code is made for;
- `cache`, `code_digest`: the files of compiled code, and how a kernel gets its name;
- `progress`: what the user is told meanwhile;
- `numba_private`: all that depends on the private side of Numba.
"""
