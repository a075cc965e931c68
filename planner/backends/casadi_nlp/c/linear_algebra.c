/* The four products that take most of fatrop's time, in vectors of four.

   casadi's BLASFEO is built for no processor in particular. A library that defines these functions and asks for
   libfatrop is searched before libblasfeo when fatrop's calls are bound; all other functions are still BLASFEO's. Each
   sum is formed in the same order and nothing is fused, so that the numbers are BLASFEO's own to the last bit:
   `linear_algebra_agrees` compares them, and until it has, and for matrices that begin within a panel, BLASFEO is
   called. Matrices are panel-major: four rows at a time, column by column. Follows lanes.h. */

#include <dlfcn.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include <blasfeo.h>

#define PANEL 4 /* rows */
#define GROUP 4 /* sums of vectors at once */

typedef double four __attribute__((vector_size(32)));
typedef double stored __attribute__((vector_size(32), aligned(8), may_alias)); /* four numbers in memory */
typedef long long mask __attribute__((vector_size(32)));
typedef struct blasfeo_dmat matrix;
typedef struct blasfeo_dvec vector;

typedef void product(int, int, int, double, matrix *, int, int, matrix *, int, int, double, matrix *, int, int,
                     matrix *, int, int);
typedef void vector_product(int, int, double, matrix *, int, int, vector *, int, double, vector *, int, vector *, int);

#ifdef __clang__
#define SHUFFLED(x, y, a, b, c, d) __builtin_shufflevector(x, y, a, b, c, d)
#else
#define SHUFFLED(x, y, a, b, c, d) __builtin_shuffle(x, y, (mask){a, b, c, d})
#endif

static int trusted = 0;

/* Where a number within it is not finite, fatrop 1.1.8 adds to the diagonal without end. It takes some hundred products
   to factor a matrix, so that after so many without new derivatives it is at that, and its call is left. */
#define PRODUCTS_MAX 50000
static _Thread_local jmp_buf *leave; /* no call is left without */
static _Thread_local int products;   /* since the last derivatives */

static void count_product(void) {
    if (leave && ++products > PRODUCTS_MAX) longjmp(*leave, 1);
}

static void *of_blasfeo(const char *name) {
    void *found = dlsym(RTLD_NEXT, name);
    if (!found) abort(); /* libfatrop could not have been loaded */
    return found;
}

static inline four load(const double *at) { return *(const stored *)at; }
static inline void store(double *at, four x) { *(stored *)at = x; }

struct tile {
    double alpha, beta;
    const double *C;
    double *D;
    int rows, columns; /* of the result, from here on */
    int above;         /* of column j, rows from above + j on are stored: not positive where all are */
};

/* Stores beta C + alpha sum in column j of a panel. */
static inline __attribute__((always_inline)) void finish(const struct tile *of, int j, four sum) {
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
static void two_panels(int depth, const double *A, int sda, const double *B, const struct tile *upper,
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

static void one_panel(int depth, const double *A, const double *B, const struct tile *only) {
    four s0 = {0.0}, s1 = {0.0}, s2 = {0.0}, s3 = {0.0};
    for (int k = 0; k < depth; k++, A += PANEL, B += PANEL) {
        const four a = load(A);
        s0 += a * B[0], s1 += a * B[1], s2 += a * B[2], s3 += a * B[3];
    }
    finish(only, 0, s0), finish(only, 1, s1), finish(only, 2, s2), finish(only, 3, s3);
}

static void multiply(int m, int n, int depth, double alpha, matrix *A, int aj, matrix *B, int bj, double beta, matrix *C,
                     int cj, matrix *D, int dj, int lower) {
    D->use_dA = 0; /* no inverse diagonal belongs to the result */
    for (int j = 0; j < n; j += PANEL)
        for (int i = lower ? j : 0; i < m; i += 2 * PANEL) {
            const double *a = A->pA + PANEL * aj + i * A->cn, *b = B->pA + PANEL * bj + j * B->cn;
            const double *c = C->pA + PANEL * (cj + j) + i * C->cn;
            double *d = D->pA + PANEL * (dj + j) + i * D->cn;
            const struct tile upper = {alpha, beta, c, d, m - i, n - j, lower ? j - i : -PANEL};
            const struct tile under = {alpha,          beta,  c + PANEL * C->cn, d + PANEL * D->cn,
                                       m - i - PANEL, n - j, upper.above - PANEL};
            if (under.rows > 0)
                two_panels(depth, a, A->cn, b, &upper, &under);
            else
                one_panel(depth, a, b, &upper);
        }
}

void blasfeo_dgemm_nt(int m, int n, int k, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                      double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj) {
    static product *original;
    count_product();
    if (trusted && !(ai | bi | ci | di)) {
        if (m > 0 && n > 0) multiply(m, n, k, alpha, A, aj, B, bj, beta, C, cj, D, dj, 0);
        return;
    }
    if (!original) original = (product *)of_blasfeo("blasfeo_dgemm_nt");
    original(m, n, k, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj);
}

void blasfeo_dsyrk_ln_mn(int m, int n, int k, double alpha, matrix *A, int ai, int aj, matrix *B, int bi, int bj,
                         double beta, matrix *C, int ci, int cj, matrix *D, int di, int dj) {
    static product *original;
    count_product();
    if (trusted && !(ai | bi | ci | di)) {
        if (m > 0 && n > 0) multiply(m, n, k, alpha, A, aj, B, bj, beta, C, cj, D, dj, 1);
        return;
    }
    if (!original) original = (product *)of_blasfeo("blasfeo_dsyrk_ln_mn");
    original(m, n, k, alpha, A, ai, aj, B, bi, bj, beta, C, ci, cj, D, di, dj);
}

/* Stores n numbers at most of z = alpha sum + beta y, without beta y where beta is zero. */
static void put(double alpha, const four *sum, double beta, const double *y, double *z, int n) {
    for (int i = 0; i < GROUP && n > 0; i++, n -= PANEL, y += PANEL, z += PANEL) {
        const four product = alpha * sum[i];
        if (n >= PANEL)
            store(z, beta == 0.0 ? product : product + beta * load(y));
        else
            for (int row = 0; row < n; row++) z[row] = beta == 0.0 ? product[row] : product[row] + beta * y[row];
    }
}

/* Adds to sums the products of 4 columns each with x (m,), row after row. */
static inline __attribute__((always_inline)) void add_columns(int sums, int m, const double *a, int sda,
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

void blasfeo_dgemv_n(int m, int n, double alpha, matrix *A, int ai, int aj, vector *x, int xi, double beta, vector *y,
                     int yi, vector *z, int zi) {
    static vector_product *original;
    if (!trusted || ai % PANEL) {
        if (!original) original = (vector_product *)of_blasfeo("blasfeo_dgemv_n");
        original(m, n, alpha, A, ai, aj, x, xi, beta, y, yi, z, zi);
        return;
    }
    const double *from = x->pa + xi, *a = A->pA + PANEL * aj + ai * A->cn;
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
        put(alpha, sum, beta, y->pa + yi + i, z->pa + zi + i, m - i);
    }
}

void blasfeo_dgemv_t(int m, int n, double alpha, matrix *A, int ai, int aj, vector *x, int xi, double beta, vector *y,
                     int yi, vector *z, int zi) {
    static vector_product *original;
    if (!trusted || ai % PANEL) {
        if (!original) original = (vector_product *)of_blasfeo("blasfeo_dgemv_t");
        original(m, n, alpha, A, ai, aj, x, xi, beta, y, yi, z, zi);
        return;
    }
    const double *from = x->pa + xi, *a = A->pA + PANEL * aj + ai * A->cn;
    for (int j = 0; j < n; j += GROUP * PANEL) {
        const int columns = n - j;
        four sum[GROUP] = {{0.0}};
        switch ((columns + PANEL - 1) / PANEL) {
        case 1: add_columns(1, m, a + PANEL * j, A->cn, from, sum); break;
        case 2: add_columns(2, m, a + PANEL * j, A->cn, from, sum); break;
        case 3: add_columns(3, m, a + PANEL * j, A->cn, from, sum); break;
        default: add_columns(4, m, a + PANEL * j, A->cn, from, sum);
        }
        put(alpha, sum, beta, y->pa + yi + j, z->pa + zi + j, columns);
    }
}

#define SAMPLE 48              /* rows and columns of the matrices compared: more than a stage's */
#define SEED 0x2545f4914f6cdd1dULL

/* A number between -1 and 1, by a linear congruence (Knuth, The Art of Computer Programming, 3.3.4). */
static double random_number(unsigned long long *state) {
    *state = *state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(long long)*state / 9223372036854775808.0;
}

/* Whether the products above give BLASFEO's numbers, to the last bit, and may be used from now on. */
int linear_algebra_agrees(void) {
#ifdef __AVX2__
    static double stored_numbers[5][SAMPLE * SAMPLE] __attribute__((aligned(64)));
    matrix all[5];
    vector vectors[5];
    unsigned long long state = SEED;
    int same = 1;
    for (int i = 0; i < 5; i++) {
        all[i] = (matrix){.pA = stored_numbers[i], .m = SAMPLE, .n = SAMPLE, .pm = SAMPLE, .cn = SAMPLE};
        vectors[i] = (vector){.pa = stored_numbers[i], .m = SAMPLE * SAMPLE, .pm = SAMPLE * SAMPLE};
    }
    for (int trial = 0; trial < 80 && same; trial++) {
        const int n = 1 + trial % 39, m = n + trial % 3, k = trial % 41, j = trial % 3;
        const double alpha = trial % 2 ? -1.0 : 0.7, beta = trial % 5 ? 1.0 : 0.0;
        for (int kind = 0; kind < 4; kind++) {
            for (int i = 0; i < 5; i++)
                for (int e = 0; e < SAMPLE * SAMPLE; e++) stored_numbers[i][e] = random_number(&state);
            memcpy(stored_numbers[4], stored_numbers[3], sizeof stored_numbers[3]);
            for (trusted = 0; trusted < 2; trusted++) { /* BLASFEO's, then these */
                matrix *D = all + 3 + trusted;
                vector *z = vectors + 3 + trusted;
                if (kind == 0) blasfeo_dgemm_nt(m, n, k, alpha, all, 0, j, all + 1, 0, 1, beta, all + 2, 0, j, D, 0, 2);
                if (kind == 1) blasfeo_dsyrk_ln_mn(m, n, k, alpha, all, 0, j, all + 1, 0, 1, beta, D, 0, 2, D, 0, 2);
                if (kind == 2) blasfeo_dgemv_n(m, n, alpha, all, 0, j, vectors + 1, 1, beta, vectors + 2, j, z, 3);
                if (kind == 3) blasfeo_dgemv_t(m, n, alpha, all, 0, j, vectors + 1, 1, beta, vectors + 2, j, z, 3);
            }
            same &= !memcmp(stored_numbers[3], stored_numbers[4], sizeof stored_numbers[3]);
        }
    }
    trusted = same;
#endif
    return trusted;
}
