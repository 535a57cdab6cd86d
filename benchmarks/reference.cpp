// The paper's top by hand, as fast as its author could make it: the yardstick of `benchmarks.speed`.
//   c++ -std=c++17 -O3 -march=native -ffast-math -mprefer-vector-width=512 -shared -fPIC reference.cpp
//       -DREAL=double -DREGISTERS=3 -DDIVIDE=0 -DPARTICLES=14 -DSPRINGS=37
// A block of copies fills REGISTERS vectors, as wide as the processor's, and the springs are passed once.
// REGISTERS=0 is a single copy: x, y and z of a particle lie in one vector, and the lengths of all springs are
// found together.
#include <cmath>
#include <initializer_list>
#include <utility>
#ifdef __AVX2__
#include <immintrin.h>
#endif
#ifdef __AVX512F__
constexpr int BYTES = 64;  // of a vector register
#else
constexpr int BYTES = 32;
#endif

constexpr int N = PARTICLES, S = SPRINGS;

// --- Vectors ------------------------------------------------------------------------------------------

#if REGISTERS
typedef REAL Register __attribute__((vector_size(BYTES)));
struct Number {  // of every copy in a block
    Register part[REGISTERS];
};
#define OPERATOR(op)                                                                            \
    static inline Number operator op(const Number &a, const Number &b) {                        \
        Number c;                                                                               \
        for (int m = 0; m < REGISTERS; m++) c.part[m] = a.part[m] op b.part[m];                 \
        return c;                                                                               \
    }                                                                                           \
    static inline Number operator op(REAL a, const Number &b) {                                 \
        Number c;                                                                               \
        for (int m = 0; m < REGISTERS; m++) c.part[m] = a op b.part[m];                         \
        return c;                                                                               \
    }
OPERATOR(+) OPERATOR(-) OPERATOR(*)

// 1/sqrt(d) to the last bit or two, by division or from an estimate. With AVX-512 the estimate has 14 bits, and a
// step of fourth order refines it; with AVX2 it has 12 bits, and steps of third and of second order do. In single
// precision a step of third order is enough.
static inline Register inverse_root(Register d) {
#if DIVIDE || !defined(__AVX2__)
    for (unsigned c = 0; c < BYTES / sizeof(REAL); c++) d[c] = 1 / std::sqrt(d[c]);
    return d;
#elif defined(__AVX512F__)
    if constexpr (sizeof(REAL) == 8) {
        const Register y = (Register)_mm512_rsqrt14_pd((__m512d)d), e = 1 - d * y * y;
        return y + y * e * (REAL(0.5) + e * (REAL(0.375) + e * REAL(0.3125)));
    } else {
        const Register y = (Register)_mm512_rsqrt14_ps((__m512)d), e = 1 - d * y * y;
        return y + y * e * (REAL(0.5) + e * REAL(0.375));
    }
#else
    if constexpr (sizeof(REAL) == 8) {
        const Register z = (Register)_mm256_cvtps_pd(_mm_rsqrt_ps(_mm256_cvtpd_ps((__m256d)d))), e = 1 - d * z * z;
        const Register y = z + z * e * (REAL(0.5) + e * REAL(0.375));
        return y + y * REAL(0.5) * (1 - d * y * y);
    } else {
        const Register y = (Register)_mm256_rsqrt_ps((__m256)d), e = 1 - d * y * y;
        return y + y * e * (REAL(0.5) + e * REAL(0.375));
    }
#endif
}
static inline Number inverse_root(Number d) {
    for (Register &part : d.part) part = inverse_root(part);
    return d;
}

struct Vector {
    Number x, y, z;
};
static inline Vector operator+(const Vector &a, const Vector &b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline Vector operator-(const Vector &a, const Vector &b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
template <class T> static inline Vector operator*(const T &s, const Vector &a) { return {s * a.x, s * a.y, s * a.z}; }
static inline Number dot(const Vector &a, const Vector &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline Vector down(const Vector &a, REAL g) { return {a.x, a.y, (-g) + a.z}; }
#else
typedef REAL Number;
typedef REAL Vector __attribute__((vector_size(4 * sizeof(REAL))));
static inline Number dot(Vector a, Vector b) {
    const Vector c = a * b;
    return c[0] + c[1] + c[2];
}
static inline Vector down(Vector a, REAL g) { return a - Vector{0, 0, g, 0}; }
#endif

// --- The body -----------------------------------------------------------------------------------------

struct Decay {  // of a damper in some time: what the velocities of its ends change by, per relative speed
    REAL first[S], second[S];
};
struct Body {
    int first[S], second[S];
    REAL stiffness[S], slack[S], damping[S];   // k, k times the rest length, c
    REAL inverse_mass[N], gravity[N];          // gravity is 0 of a pinned particle
    Decay whole, half;
};
typedef Vector Rows[N];
enum Dampers { NONE, SWEPT, IN_FORCE };

// Add the springs' forces to f; if IN_FORCE, those of the dampers at the velocities u; if SWEPT, keep directions.
template <Dampers D>
static inline void pull(const Body &b, const Rows x, const Rows u, Rows f, Vector *direction) {
#if REGISTERS
    for (int s = 0; s < S; s++) {
        const int i = b.first[s], j = b.second[s];
        const Vector apart = x[j] - x[i];
        const Number inverse = inverse_root(dot(apart, apart));
        Number pull = b.stiffness[s] - b.slack[s] * inverse;
        if (D == IN_FORCE) pull = pull + b.damping[s] * (dot(u[j] - u[i], apart) * inverse) * inverse;
        const Vector force = pull * apart;
        f[i] = f[i] + force;
        f[j] = f[j] - force;
        if (D == SWEPT) direction[s] = inverse * apart;
    }
#else
    alignas(64) Vector apart[S];
    alignas(64) REAL square[S], inverse[S], rate[S];
    for (int s = 0; s < S; s++) {
        apart[s] = x[b.second[s]] - x[b.first[s]];
        square[s] = dot(apart[s], apart[s]);
        if (D == IN_FORCE) rate[s] = dot(u[b.second[s]] - u[b.first[s]], apart[s]);
    }
    REAL *pull = square;
    for (int s = 0; s < S; s++) {
        inverse[s] = 1 / std::sqrt(square[s]);
        pull[s] = b.stiffness[s] - b.slack[s] * inverse[s];
        if (D == IN_FORCE) pull[s] += b.damping[s] * rate[s] * inverse[s] * inverse[s];
    }
    for (int s = 0; s < S; s++) {
        const Vector force = pull[s] * apart[s];
        f[b.first[s]] = f[b.first[s]] + force;
        f[b.second[s]] = f[b.second[s]] - force;
        if (D == SWEPT) direction[s] = inverse[s] * apart[s];
    }
#endif
}

// Velocities after the dampers, one after the other, for a whole step or for half.
static inline void sweep(const Body &b, Rows v, const Vector *direction, const Decay &decay, bool back) {
    for (int n = 0; n < S; n++) {
        const int s = back ? S - 1 - n : n, i = b.first[s], j = b.second[s];
        const Number speed = dot(v[j] - v[i], direction[s]);
        v[i] = v[i] + speed * (decay.first[s] * direction[s]);
        v[j] = v[j] - speed * (decay.second[s] * direction[s]);
    }
}

static inline Vector acceleration(const Body &b, const Rows f, int i) {
    return down(b.inverse_mass[i] * f[i], b.gravity[i]);
}

// --- Methods ------------------------------------------------------------------------------------------

// Velocity Verlet. Where no damper is split off, the two half kicks between drifts are one.
template <Dampers D> static void verlet(const Body &b, Vector *x, Vector *v, int steps, REAL h) {
    alignas(64) Rows f, u;
    alignas(64) Vector direction[D == SWEPT ? S : 1];
    for (int i = 0; i < N; i++) f[i] = Vector{}, u[i] = v[i];
    pull<D>(b, x, u, f, direction);
    for (int t = 0; t < steps; t++) {
        if (D == SWEPT && t == 0) sweep(b, v, direction, b.half, false);
        if (D == SWEPT && t > 0) {
            for (int i = 0; i < N; i++) v[i] = v[i] + h / 2 * acceleration(b, f, i);
            sweep(b, v, direction, b.whole, t % 2 == 1);
        }
        const REAL kick = D == SWEPT || t == 0 ? h / 2 : h;
        for (int i = 0; i < N; i++) {
            const Vector a = acceleration(b, f, i);
            v[i] = v[i] + kick * a;
            x[i] = x[i] + h * v[i];
            if (D == IN_FORCE) u[i] = v[i] + h / 2 * a;  // at the next node, by the last acceleration
            f[i] = Vector{};
        }
        pull<D>(b, x, u, f, direction);
    }
    for (int i = 0; i < N; i++) v[i] = v[i] + h / 2 * acceleration(b, f, i);
    if (D == SWEPT) sweep(b, v, direction, b.half, true);
}

// The classical Runge-Kutta method, without dampers.
static void rk4(const Body &b, Vector *x, Vector *v, int steps, REAL h) {
    alignas(64) Rows f, xs, vs, dx, dv;
    for (int i = 0; i < N; i++) f[i] = Vector{};
    for (int t = 0; t < steps; t++) {
        pull<NONE>(b, x, v, f, nullptr);
        for (int i = 0; i < N; i++) {
            const Vector a = acceleration(b, f, i);
            dx[i] = v[i], dv[i] = a;
            xs[i] = x[i] + h / 2 * v[i], vs[i] = v[i] + h / 2 * a;
            f[i] = Vector{};
        }
        for (int stage = 0; stage < 2; stage++) {
            const REAL ahead = stage ? h : h / 2;
            pull<NONE>(b, xs, vs, f, nullptr);
            for (int i = 0; i < N; i++) {
                const Vector a = acceleration(b, f, i), u = vs[i];
                dx[i] = dx[i] + REAL(2) * u, dv[i] = dv[i] + REAL(2) * a;
                xs[i] = x[i] + ahead * u, vs[i] = v[i] + ahead * a;
                f[i] = Vector{};
            }
        }
        pull<NONE>(b, xs, vs, f, nullptr);
        for (int i = 0; i < N; i++) {
            x[i] = x[i] + h / 6 * (dx[i] + vs[i]);
            v[i] = v[i] + h / 6 * (dv[i] + acceleration(b, f, i));
            f[i] = Vector{};
        }
    }
}

// --- What Python calls --------------------------------------------------------------------------------

extern "C" int register_bytes() { return BYTES; }

// Positions and velocities are (blocks, PARTICLES) of Vector; the body's arrays are of doubles.
// method: 0 rk4, 1 verlet, 2 verlet with dampers swept, 3 verlet with dampers in the force.
extern "C" void advance(int method, REAL *positions, REAL *velocities, int blocks, int steps, double h,
                        const int *first, const int *second, const double *length, const double *stiffness,
                        const double *damping, const double *inverse_mass, double gravity) {
    static Body b;
    for (int i = 0; i < N; i++) b.inverse_mass[i] = inverse_mass[i], b.gravity[i] = inverse_mass[i] > 0 ? gravity : 0;
    for (int s = 0; s < S; s++) {
        b.first[s] = first[s], b.second[s] = second[s];
        b.stiffness[s] = stiffness[s], b.slack[s] = stiffness[s] * length[s], b.damping[s] = damping[s];
        const double m = inverse_mass[first[s]], n = inverse_mass[second[s]], w = m + n;
        for (auto [decay, time] : {std::pair{&b.whole, h}, std::pair{&b.half, h / 2}}) {
            const double impulse = w > 0 ? -std::expm1(-damping[s] * w * time) / w : 0;
            decay->first[s] = impulse * m, decay->second[s] = impulse * n;
        }
    }
    for (int n = 0; n < blocks; n++) {
        Vector *x = (Vector *)positions + n * N, *v = (Vector *)velocities + n * N;
        if (method == 0) rk4(b, x, v, steps, h);
        if (method == 1) verlet<NONE>(b, x, v, steps, h);
        if (method == 2) verlet<SWEPT>(b, x, v, steps, h);
        if (method == 3) verlet<IN_FORCE>(b, x, v, steps, h);
    }
}
