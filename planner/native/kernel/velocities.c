/* Joint velocities for tool velocities, and bounds on the times of launches to them.

   They are calculated for thousands of states, so for four at once: every operation applies to one number of each, and
   they come out as they would alone, to the last bit. */

#include "vectors.h"

/* Before a function: it takes the instructions for four numbers, where the processor has them. */
#if !defined(WIDEST) && defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define WIDEST __attribute__((target_clones("avx2", "default")))
#elif !defined(WIDEST)
#define WIDEST
#endif

/* Before what those functions call: it becomes a part of them. A function of its own would take its arguments, of which
   each is four numbers, as processors without those instructions do. */
#define INLINE static inline __attribute__((always_inline))

typedef double four __attribute__((vector_size(32)));
typedef long long four_bits __attribute__((vector_size(32)));
enum { LANES = 4 };

INLINE four spread(double x) { return (four){x, x, x, x}; }

INLINE four chosen(four_bits where, four a, four b) {
    return (four)(((four_bits)a & where) | ((four_bits)b & ~where));
}

INLINE four larger_of(four a, four b) { return chosen((a > b) | (a != a), a, b); } /* NaN where either is one */
INLINE four size_of(four a) { return (four)((four_bits)a & 0x7fffffffffffffffLL); }
INLINE four root_of(four a) { return (four){sqrt(a[0]), sqrt(a[1]), sqrt(a[2]), sqrt(a[3])}; }
INLINE four dot_of(const four *a, const four *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Numbers (n,) of four states from the `first` of k on, whose rows (rows, n) are taken in turn. The last state stands
   for those that are missing. */
INLINE void gather(count k, count first, in values, count rows, int n, four *out) {
    in of[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        count state = first + lane < k ? first + lane : k - 1;
        of[lane] = values + n * (rows < k ? state % rows : state);
    }
    for (int i = 0; i < n; i++) out[i] = (four){of[0][i], of[1][i], of[2][i], of[3][i]};
}

/* Sets rows (k, n) to numbers (n,) of four states from the `first` on, as many as there are. */
INLINE void scatter(count k, count first, const four *values, int n, double *rows) {
    for (int lane = 0; lane < LANES && first + lane < k; lane++)
        for (int i = 0; i < n; i++) rows[n * (first + lane) + i] = values[i][lane];
}

/* What the weighted least-norm joint velocities of a Jacobian (3, 6) need, see `_weighted`. */
struct inverse {
    four w[3][6], c00, c01, c02, c11, c12, c22, scale;
};

INLINE void invert(const four *J, const four *weight, double floor, struct inverse *of) {
    four g[3][3];
    for (int row = 0; row < 3; row++)
        for (int i = 0; i < 6; i++) of->w[row][i] = weight[i] * J[6 * row + i];
    for (int row = 0; row < 3; row++)
        for (int other = row; other < 3; other++) {
            const four *y = J + 6 * other;
            g[row][other] = dot_of(of->w[row], y) + dot_of(of->w[row] + 3, y + 3);
        }
    four share = floor * (g[0][0] + g[1][1] + g[2][2]);
    four xx = g[0][0] + share, yy = g[1][1] + share, zz = g[2][2] + share, xy = g[0][1], xz = g[0][2], yz = g[1][2];
    of->c00 = yy * zz - yz * yz, of->c01 = xz * yz - xy * zz, of->c02 = xy * yz - xz * yy;
    of->c11 = xx * zz - xz * xz, of->c12 = xy * xz - xx * yz, of->c22 = xx * yy - xy * xy;
    of->scale = 1.0 / (xx * of->c00 + xy * of->c01 + xz * of->c02);
}

/* Adds the joint velocities for a velocity (3,). */
INLINE void add_least_norm(const struct inverse *of, const four *v, four *qd) {
    four a = v[0] * of->scale, b = v[1] * of->scale, c = v[2] * of->scale;
    four first = of->c00 * a + of->c01 * b + of->c02 * c, second = of->c01 * a + of->c11 * b + of->c12 * c;
    four third = of->c02 * a + of->c12 * b + of->c22 * c;
    for (int i = 0; i < 6; i++) qd[i] += first * of->w[0][i] + second * of->w[1][i] + third * of->w[2][i];
}

/* Sets the joint velocities (6,) for a velocity (3,), corrected by what they miss it by `refinements` times. */
INLINE void weighted(const four *J, const four *weight, const four *v, double floor, int refinements, four *qd) {
    struct inverse of;
    invert(J, weight, floor, &of);
    for (int i = 0; i < 6; i++) qd[i] = spread(0.0);
    add_least_norm(&of, v, qd);
    for (int time = 0; time < refinements; time++) {
        four missed[3];
        for (int row = 0; row < 3; row++)
            missed[row] = v[row] - dot_of(J + 6 * row, qd) - dot_of(J + 6 * row + 3, qd + 3);
        add_least_norm(&of, missed, qd);
    }
}

/* Joint velocities (k, 6) for Jacobians (n, 3, 6), taken in turn, and velocities (k, 3). */
WIDEST void least_norms(count k, in v, count n, in J, in weight, double floor, double *out) {
    four at[18], weights[6], to[3], qd[6];
    for (int i = 0; i < 6; i++) weights[i] = spread(weight[i]);
    for (count m = 0; m < k; m += LANES) {
        gather(k, m, J, n, 18, at);
        gather(k, m, v, k, 3, to);
        weighted(at, weights, to, floor, 0, qd);
        scatter(k, m, qd, 6, out);
    }
}

/* The largest share of a limit; sets the shares (6,). */
INLINE four shares(const four *qd, in qd_max, four *share) {
    four most = spread(0.0);
    for (int i = 0; i < 6; i++) {
        share[i] = size_of(qd[i]) / qd_max[i];
        most = larger_of(share[i], most);
    }
    return most;
}

/* Largest shares (k,) of the limits in joint velocities qd (k, 6). */
WIDEST void largest_shares(count k, in qd, in qd_max, double *out) {
    four to[6], share[6];
    for (count m = 0; m < k; m += LANES) {
        gather(k, m, qd, k, 6, to);
        four most = shares(to, qd_max, share);
        scatter(k, m, &most, 1, out);
    }
}

/* Moves joint velocities (6,) towards those of least p-norm of the shares of the limits. */
INLINE void approach_norm(const four *J, const four *v, in qd_max, double p, in floors, int times, four *qd) {
    four share[6], weight[6], least[6], most = shares(qd, qd_max, share);
    for (int i = 0; i < 6; i++) {
        four relative = larger_of(share[i] / most, spread(floors[0])), power = spread(1.0);
        for (int factor = 2; factor < p; factor++) power *= relative;
        weight[i] = qd_max[i] * qd_max[i] / power;
    }
    weighted(J, weight, v, floors[1], times, least);
    for (int i = 0; i < 6; i++) qd[i] += (least[i] - qd[i]) / (p - 1.0);
}

/* Joint velocities out (k, 6) from qd (k, 6), see `_towards_maximum_norm`; p (norms,) whole. */
WIDEST void lower_shares(count k, in J, in v, in qd, in qd_max, count norms, in p, in floors, count times, double *out) {
    four at[18], to[3], lower[6];
    for (count m = 0; m < k; m += LANES) {
        gather(k, m, J, k, 18, at);
        gather(k, m, v, k, 3, to);
        gather(k, m, qd, k, 6, lower);
        for (count i = 0; i < norms; i++) approach_norm(at, to, qd_max, p[i], floors, (int)times, lower);
        scatter(k, m, lower, 6, out);
    }
}

/* Least times over distances to velocities, see `least_time`. */
INLINE four least_time(four distance, four qd, double v_max, double a_max) {
    four turn = chosen(distance >= qd * size_of(qd) / (2.0 * a_max), spread(1.0), spread(-1.0));
    four d = turn * distance, v = turn * qd, peak = root_of(larger_of(a_max * d + v * v / 2.0, spread(0.0)));
    four accelerating = (2.0 * v_max * v_max - v * v) / (2.0 * a_max);
    four cruising = (2.0 * v_max - v) / a_max + (d - accelerating) / v_max;
    return chosen(peak <= v_max, (2.0 * peak - v) / a_max, cruising);
}

/* Lower bounds (k,) on the times of launches to velocities qd (k, 6) in postures q (n, 6), taken in turn; see
   `penalised_bound`. */
WIDEST void penalised_bounds(count k, in qd, count n, in q, in start, in v_max, in a_max, double penalty, double *out) {
    four to[6], at[6], share[6];
    for (count m = 0; m < k; m += LANES) {
        gather(k, m, qd, k, 6, to);
        gather(k, m, q, n, 6, at);
        four excess = shares(to, v_max, share), bound = spread(-INFINITY);
        for (int i = 0; i < 6; i++) bound = larger_of(least_time(at[i] - start[i], to[i], v_max[i], a_max[i]), bound);
        four sum = excess + bound, penalised = chosen(excess <= 1.0, bound, penalty * excess);
        penalised = chosen(sum != sum, spread(INFINITY), penalised);
        scatter(k, m, &penalised, 1, out);
    }
}
