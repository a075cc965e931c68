/* The four products that take most of fatrop's time, in vectors of four.

   casadi's BLASFEO is built for no processor in particular. A library that defines these functions and asks for
   libfatrop is searched before libblasfeo when fatrop's calls are bound; all other functions are still BLASFEO's. Each
   sum is formed in the same order and nothing is fused, so that the numbers are BLASFEO's own to the last bit, with
   wider instructions and without. Matrices are panel-major: four rows at a time, column by column. */

#include <blasfeo.h>

#include "products.h"

#define PANEL 4 /* rows */
#define GROUP 4 /* sums of vectors at once */

#if D_PS != PANEL
#error "casadi's BLASFEO has other panels"
#endif

/* Before a function: it takes the instructions for four numbers, where the processor has them. What it calls becomes a
   part of it. */
#if !defined(WIDEST) && defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define WIDEST __attribute__((target_clones("avx2", "default")))
#elif !defined(WIDEST)
#define WIDEST
#endif
#define INLINE static inline __attribute__((always_inline))

typedef double four __attribute__((vector_size(32)));
typedef double stored __attribute__((vector_size(32), aligned(8), may_alias)); /* four numbers in memory */
typedef long long mask __attribute__((vector_size(32)));
typedef struct blasfeo_dmat matrix;
typedef struct blasfeo_dvec vector;

#ifdef __clang__
#define SHUFFLED(x, y, a, b, c, d) __builtin_shufflevector(x, y, a, b, c, d)
#else
#define SHUFFLED(x, y, a, b, c, d) __builtin_shuffle(x, y, (mask){a, b, c, d})
#endif

/* Where a number within it is not finite, fatrop 1.1.8 adds to the diagonal without end, and cannot be asked to return.
   It takes some hundred products to factor a matrix, so that after so many without new derivatives it is at that, and
   its call is left. */
#define PRODUCTS_MAX 50000
_Thread_local int products;
_Thread_local jmp_buf *leave;

INLINE four load(const double *at) { return *(const stored *)at; }
INLINE void store(double *at, four x) { *(stored *)at = x; }

struct tile {
    double alpha, beta;
    const double *C;
    double *D;
    int rows, columns; /* of the result, from here on */
    int above;         /* of column j, rows from above + j on are stored: not positive where all are */
};

/* Stores beta C + alpha sum in column j of a panel. */
INLINE void finish(const struct tile *of, int j, four sum) {
    if (j >= of->columns) return;
    const four whole = of->beta * load(of->C + PANEL * j) + of->alpha * sum;
    double *to = of->D + PANEL * j;
    const int first = of->above + j;
    if (first <= 0 && of->rows >= PANEL) {
        store(to, whole);
        return;
    }
    for (int row = first > 0 ? first : 0; row < PANEL && row < of->rows; row++) to[row] = whole[row];
}

/* Two panels of A times one of B transposed: eight sums in registers. */
INLINE void two_panels(int depth, const double *A, int sda, const double *B, const struct tile *upper,
                       const struct tile *under) {
    const double *A1 = A + PANEL * sda;
    four s00 = {0.0}, s01 = {0.0}, s02 = {0.0}, s03 = {0.0}, s10 = {0.0}, s11 = {0.0}, s12 = {0.0}, s13 = {0.0};
    for (int k = 0; k < depth; k++, A += PANEL, A1 += PANEL, B += PANEL) {
        const four a0 = load(A), a1 = load(A1);
        s00 += a0 * B[0], s10 += a1 * B[0];
        s01 += a0 * B[1], s11 += a1 * B[1];
        s02 += a0 * B[2], s12 += a1 * B[2];
        s03 += a0 * B[3], s13 += a1 * B[3];
    }
    finish(upper, 0, s00), finish(upper, 1, s01), finish(upper, 2, s02), finish(upper, 3, s03);
    finish(under, 0, s10), finish(under, 1, s11), finish(under, 2, s12), finish(under, 3, s13);
}

INLINE void one_panel(int depth, const double *A, const double *B, const struct tile *only) {
    four s0 = {0.0}, s1 = {0.0}, s2 = {0.0}, s3 = {0.0};
    for (int k = 0; k < depth; k++, A += PANEL, B += PANEL) {
        const four a = load(A);
        s0 += a * B[0], s1 += a * B[1], s2 += a * B[2], s3 += a * B[3];
    }
    finish(only, 0, s0), finish(only, 1, s1), finish(only, 2, s2), finish(only, 3, s3);
}

static WIDEST void multiply(int m, int n, int depth, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                            double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj, int lower) {
    for (int j = 0; j < n; j += PANEL)
        for (int i = lower ? j : 0; i < m; i += 2 * PANEL) {
            const double *a = A->pA + PANEL * aj + (ai + i) * A->cn, *b = B->pA + PANEL * bj + (bi + j) * B->cn;
            const double *c = C->pA + PANEL * (cj + j) + (ci + i) * C->cn;
            double *d = D->pA + PANEL * (dj + j) + (di + i) * D->cn;
            const struct tile upper = {alpha, beta, c, d, m - i, n - j, lower ? j - i : -PANEL};
            const struct tile under = {alpha,         beta,  c + PANEL * C->cn,  d + PANEL * D->cn,
                                       m - i - PANEL, n - j, upper.above - PANEL};
            if (under.rows > 0)
                two_panels(depth, a, A->cn, b, &upper, &under);
            else
                one_panel(depth, a, b, &upper);
        }
}

/* The same, number by number: for matrices that begin within a panel. */
static void multiply_slowly(int m, int n, int depth, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                            double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj, int lower) {
    for (int j = 0; j < n; j++)
        for (int i = lower ? j : 0; i < m; i++) {
            double sum = 0.0;
            for (int k = 0; k < depth; k++) sum += BLASFEO_DMATEL(A, ai + i, aj + k) * BLASFEO_DMATEL(B, bi + j, bj + k);
            BLASFEO_DMATEL(D, di + i, dj + j) = beta * BLASFEO_DMATEL(C, ci + i, cj + j) + alpha * sum;
        }
}

static void product(int m, int n, int depth, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                    double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj, int lower) {
    if (leave && ++products > PRODUCTS_MAX) longjmp(*leave, 1);
    D->use_dA = 0; /* no inverse diagonal belongs to the result */
    if ((ai | bi | ci | di) % PANEL)
        multiply_slowly(m, n, depth, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj, lower);
    else
        multiply(m, n, depth, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj, lower);
}

void blasfeo_dgemm_nt(int m, int n, int k, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                      double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj) {
    product(m, n, k, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj, 0);
}

void blasfeo_dsyrk_ln_mn(int m, int n, int k, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                         double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj) {
    product(m, n, k, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj, 1);
}

/* Stores n numbers at most of z = alpha sum + beta y, without beta y where beta is zero. */
INLINE void put(double alpha, const four *sum, double beta, const double *y, double *z, int n) {
    for (int i = 0; i < GROUP && n > 0; i++, n -= PANEL, y += PANEL, z += PANEL) {
        const four product = alpha * sum[i];
        if (n >= PANEL)
            store(z, beta == 0.0 ? product : product + beta * load(y));
        else
            for (int row = 0; row < n; row++) z[row] = beta == 0.0 ? product[row] : product[row] + beta * y[row];
    }
}

/* Adds to sums the products of 4 columns each with x (m,), row after row. */
INLINE void add_columns(int sums, int m, const double *a, int sda,
                                                              const double *x, four *sum) {
    four total[GROUP] = {{0.0}};
    for (int k = 0; k < m; k += PANEL, a += PANEL * sda)
#pragma GCC unroll 4
        for (int i = 0; i < sums; i++) {
            const double *c = a + PANEL * PANEL * i;
            const four c0 = load(c), c1 = load(c + PANEL), c2 = load(c + 2 * PANEL), c3 = load(c + 3 * PANEL);
            const four even = SHUFFLED(c0, c1, 0, 4, 2, 6), odd = SHUFFLED(c0, c1, 1, 5, 3, 7);
            const four even_beside = SHUFFLED(c2, c3, 0, 4, 2, 6), odd_beside = SHUFFLED(c2, c3, 1, 5, 3, 7);
            total[i] += SHUFFLED(even, even_beside, 0, 1, 4, 5) * x[k];
            if (k + 1 < m) total[i] += SHUFFLED(odd, odd_beside, 0, 1, 4, 5) * x[k + 1];
            if (k + 2 < m) total[i] += SHUFFLED(even, even_beside, 2, 3, 6, 7) * x[k + 2];
            if (k + 3 < m) total[i] += SHUFFLED(odd, odd_beside, 2, 3, 6, 7) * x[k + 3];
        }
    for (int i = 0; i < sums; i++) sum[i] = total[i];
}

static WIDEST void multiply_rows(int m, int n, double alpha, matrix *A, int ai, int aj, const double *from, double beta,
                                 const double *y, double *z) {
    const double *a = A->pA + PANEL * aj + ai * A->cn;
    const int stride = PANEL * A->cn;
    for (int i = 0; i < m; i += GROUP * PANEL, a += GROUP * stride) {
        const int left = (m - i + PANEL - 1) / PANEL;
        /* Sums that do not wait for each other; of panels beyond the last, the last again. */
        const double *a1 = a + (left > 1 ? stride : 0), *a2 = a1 + (left > 2 ? stride : 0);
        const double *a3 = a2 + (left > 3 ? stride : 0);
        four sum[GROUP], s0 = {0.0}, s1 = {0.0}, s2 = {0.0}, s3 = {0.0};
        for (int k = 0; k < n; k++) {
            s0 += load(a + PANEL * k) * from[k], s1 += load(a1 + PANEL * k) * from[k];
            s2 += load(a2 + PANEL * k) * from[k], s3 += load(a3 + PANEL * k) * from[k];
        }
        sum[0] = s0, sum[1] = s1, sum[2] = s2, sum[3] = s3;
        put(alpha, sum, beta, y + i, z + i, m - i);
    }
}

static WIDEST void multiply_columns(int m, int n, double alpha, matrix *A, int ai, int aj, const double *from,
                                    double beta, const double *y, double *z) {
    const double *a = A->pA + PANEL * aj + ai * A->cn;
    for (int j = 0; j < n; j += GROUP * PANEL) {
        const int columns = n - j;
        four sum[GROUP] = {{0.0}};
        switch ((columns + PANEL - 1) / PANEL) {
        case 1: add_columns(1, m, a + PANEL * j, A->cn, from, sum); break;
        case 2: add_columns(2, m, a + PANEL * j, A->cn, from, sum); break;
        case 3: add_columns(3, m, a + PANEL * j, A->cn, from, sum); break;
        default: add_columns(4, m, a + PANEL * j, A->cn, from, sum);
        }
        put(alpha, sum, beta, y + j, z + j, columns);
    }
}

/* A number of z, of a matrix that begins within a panel: as the sums of BLASFEO for such are formed. */
INLINE double put_one(double alpha, double sum, double beta, double y) {
    return beta == 0.0 ? alpha * sum : alpha * sum + beta * y;
}

void blasfeo_dgemv_n(int m, int n, double alpha, matrix *A, int ai, int aj, vector *x, int xi, double beta, vector *y,
                     int yi, vector *z, int zi) {
    const double *from = x->pa + xi, *old = y->pa + yi;
    double *to = z->pa + zi;
    if (ai % PANEL == 0) {
        multiply_rows(m, n, alpha, A, ai, aj, from, beta, old, to);
        return;
    }
    for (int i = 0; i < m; i++) {
        double sum = 0.0;
        for (int k = 0; k < n; k++) sum += BLASFEO_DMATEL(A, ai + i, aj + k) * from[k];
        to[i] = put_one(alpha, sum, beta, old[i]);
    }
}

void blasfeo_dgemv_t(int m, int n, double alpha, matrix *A, int ai, int aj, vector *x, int xi, double beta, vector *y,
                     int yi, vector *z, int zi) {
    const double *from = x->pa + xi, *old = y->pa + yi;
    double *to = z->pa + zi;
    if (ai % PANEL == 0) {
        multiply_columns(m, n, alpha, A, ai, aj, from, beta, old, to);
        return;
    }
    for (int j = 0; j < n; j++) {
        double sum = 0.0;
        for (int k = 0; k < m; k++) sum += BLASFEO_DMATEL(A, ai + k, aj + j) * from[k];
        to[j] = put_one(alpha, sum, beta, old[j]);
    }
}
