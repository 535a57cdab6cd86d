// The paper's top by the classical Runge–Kutta method, written by hand: copies innermost, as
// springgym's kernels have them. The yardstick of `springgym bench`.
//   c++ -O3 -march=native -ffast-math -DREAL=double -DWIDTH=8 -shared -fPIC reference.cpp
#include <cmath>
#include <cstddef>

constexpr int W = WIDTH;      // copies in a block
constexpr int MOST = 64 * 3;  // particles, springs: at most 64

static void accelerate(int particles, int springs, const REAL *__restrict x, REAL *__restrict a,
                       REAL *__restrict f, const int *first, const int *second, const REAL *length,
                       const REAL *stiffness, const REAL *inverse_mass) {
    for (int s = 0; s < springs; s++) {
        const REAL *xi = x + first[s] * 3 * W, *xj = x + second[s] * 3 * W;
        REAL *fs = f + s * 3 * W;
        for (int c = 0; c < W; c++) {
            REAL dx = xj[c] - xi[c], dy = xj[W + c] - xi[W + c], dz = xj[2 * W + c] - xi[2 * W + c];
            REAL pull = stiffness[s] * (1 - length[s] / std::sqrt(dx * dx + dy * dy + dz * dz));
            fs[c] = pull * dx, fs[W + c] = pull * dy, fs[2 * W + c] = pull * dz;
        }
    }
    for (int n = 0; n < particles * 3 * W; n++) a[n] = 0;
    for (int s = 0; s < springs; s++) {
        REAL *ai = a + first[s] * 3 * W, *aj = a + second[s] * 3 * W;
        const REAL *fs = f + s * 3 * W;
        for (int c = 0; c < 3 * W; c++) ai[c] += fs[c];
        for (int c = 0; c < 3 * W; c++) aj[c] -= fs[c];
    }
    for (int i = 0; i < particles; i++) {
        for (int c = 0; c < 3 * W; c++) a[i * 3 * W + c] *= inverse_mass[i];
        if (inverse_mass[i] > 0)
            for (int c = 0; c < W; c++) a[(i * 3 + 2) * W + c] -= REAL(9.81);
    }
}

extern "C" void advance(REAL *positions, REAL *velocities, int blocks, int steps, REAL h, int particles,
                        int springs, const int *first, const int *second, const REAL *length,
                        const REAL *stiffness, const REAL *inverse_mass) {
    alignas(64) static REAL a[MOST * W], f[MOST * W], xs[MOST * W], vs[MOST * W], dx[MOST * W], dv[MOST * W];
    const int size = particles * 3 * W;
    for (int b = 0; b < blocks; b++) {
        REAL *x = positions + (std::size_t)b * size, *v = velocities + (std::size_t)b * size;
        auto at = [&](const REAL *where) {
            accelerate(particles, springs, where, a, f, first, second, length, stiffness, inverse_mass);
        };
        for (int t = 0; t < steps; t++) {
            at(x);
            for (int n = 0; n < size; n++) {
                dx[n] = v[n], dv[n] = a[n];
                xs[n] = x[n] + h / 2 * v[n], vs[n] = v[n] + h / 2 * a[n];
            }
            for (int stage = 0; stage < 2; stage++) {
                const REAL ahead = stage ? h : h / 2;
                at(xs);
                for (int n = 0; n < size; n++) {
                    const REAL speed = vs[n];
                    dx[n] += 2 * speed, dv[n] += 2 * a[n];
                    xs[n] = x[n] + ahead * speed, vs[n] = v[n] + ahead * a[n];
                }
            }
            at(xs);
            for (int n = 0; n < size; n++) {
                x[n] += h / 6 * (dx[n] + vs[n]);
                v[n] += h / 6 * (dv[n] + a[n]);
            }
        }
    }
}
