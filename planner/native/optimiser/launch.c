/* A launch and brake as fatrop's C interface takes it: rows, derivatives and bounds, stage by stage.

   What casadi's interface to fatrop does by way of sparse matrices of the whole problem is done stage
   by stage here, several stages at once, with every sum in the same order, so that both find the same numbers to the
   last bit. Variables in Python's order: z_0 .. z_N, each state then control, the last without one; fatrop takes each
   control before its state. */

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <fatrop/ocp/OCPCInterface.h>

#include "lanes.h"
#include "products.h"

#define STATES 19
#define CONTROLS 7
#define VARIABLES (STATES + CONTROLS)
#define TIME 18 /* among the states: before the release, negative */
#define THROWN 6
#define WITH_THROWN (VARIABLES + THROWN)     /* with the states of the object in flight, on some stages */
#define ROWS_MAX 64                          /* of a block */
#define ENTRIES_MAX (ROWS_MAX * WITH_THROWN) /* of its derivatives */
#define BROKEN (-1)                          /* status of a call, beside fatrop's */
#define LATE (-2)
#define OUT_OF_TIME (-3)
#define FREE 0x7fffffff                      /* column of a row without bounds */

typedef struct blasfeo_dmat matrix;
typedef struct FatropOcpCDims dims;

/* Rows of one kind on a range of stages. */
struct block {
    void (*value)(const lanes *z, const void *p, lanes *rows);
    void (*slope)(const lanes *z, const void *p, lanes *rows, lanes *jacobian);
    void (*curve)(const lanes *z, const void *p, const lanes *multipliers, lanes *gradient, lanes *hessian);
    const long long *jacobian, *hessian; /* sparsity: rows, columns, first entry of each column, row of each entry */
    const int *position;                 /* of each row on each of its stages in the whole problem */
    int variables, rows;                 /* the variables that its rows are of: a stage's, and the object's or not */
    int following, into;                 /* the first `following` rows are the next stage's states `into` .. */
    int first, last;                     /* stages first .. last - 1 */
    int parameters, each;                /* where its parameters begin, and how many each stage has of its own */
};

/* `own`: where the rows of each stage begin, beside the next state, and how many there are; `block[cost]` is the
   objective's. From stage `thrown` on, the object has states; `stages` + 1 where it has none. */
struct problem {
    const struct block *block;
    const int *own, *owned;
    int blocks, cost, stages, rows, thrown;
};

/* One call of the solver. `columns`: of each row, then of each variable, in the matrix of its stage: of equalities
   from -1 down, of inequalities from 0 up. `bounded`: rows and variables by stage, inequalities then equalities,
   rows before variables, in fatrop's order. */
struct call {
    const struct problem *of;
    const double *lower, *upper, *guess, *p; /* bounds of variables, then of rows */
    double latest;                           /* time of the release, scaled, beyond which it is of no use */
    double until;                            /* on `now`: no iteration begins after it */
    struct FatropOcpCSolver *solver;
    double *z, *g, *multipliers, *gradient;
    int *columns, *inequality, *equality, *inequalities, *equalities; /* lists, and where each stage's begin */
    volatile int broken;     /* whether some derivative was not finite; volatile, as it is read after a `longjmp` */
    volatile int ended;      /* status with which it was ended, 0 where it was not */
    volatile int iterations; /* begun, by the second derivatives evaluated */
};

static int has_thrown(const struct problem *of, int stage) { return stage >= of->thrown; }
static int controls(const struct problem *of, int stage) { return stage < of->stages ? CONTROLS : 0; }

static int states(const struct problem *of, int stage) { return STATES + (has_thrown(of, stage) ? THROWN : 0); }

/* Variables in Python's order, the object's last. */
static int core(const struct problem *of) { return of->stages * VARIABLES + STATES; }

static int first_thrown(const struct problem *of, int stage) { return core(of) + THROWN * (stage - of->thrown); }
static int variables(const struct problem *of) { return first_thrown(of, of->stages + 1); }

/* Those of a stage in the order of `z`, in which every stage has all of them: state, control, object. */
static int exists(const struct problem *of, int stage, int i) {
    return i < STATES || (i < VARIABLES ? stage < of->stages : has_thrown(of, stage));
}

/* Position of variable i of a stage among fatrop's: controls, states, the object's states. */
static int placed(int i, int controls) {
    return i < STATES ? i + controls : i < VARIABLES ? i - STATES : i - CONTROLS + controls;
}

static double *thrown_at(double *z, int stage) { return z + WITH_THROWN * stage + VARIABLES; }

static void read_variables(const struct call *call, const double *primal, const dims *s) {
    for (int k = 0; k <= call->of->stages; k++) {
        const int n = controls(call->of, k);
        const double *from = primal + s->ux_offs[k];
        memcpy(call->z + WITH_THROWN * k, from + n, STATES * sizeof(double));
        memcpy(call->z + WITH_THROWN * k + STATES, from, (size_t)n * sizeof(double));
        if (has_thrown(call->of, k)) memcpy(thrown_at(call->z, k), from + n + STATES, THROWN * sizeof(double));
    }
}

/* Sets `z` from variables in Python's order, or the other way round. */
static void unpack(const struct problem *of, const double *x, double *z) {
    for (int k = 0; k <= of->stages; k++) {
        memcpy(z + WITH_THROWN * k, x + VARIABLES * k, (size_t)(STATES + controls(of, k)) * sizeof(double));
        if (has_thrown(of, k)) memcpy(thrown_at(z, k), x + first_thrown(of, k), THROWN * sizeof(double));
    }
}

static void pack(const struct problem *of, double *z, double *x) {
    for (int k = 0; k <= of->stages; k++) {
        memcpy(x + VARIABLES * k, z + WITH_THROWN * k, (size_t)(STATES + controls(of, k)) * sizeof(double));
        if (has_thrown(of, k)) memcpy(x + first_thrown(of, k), thrown_at(z, k), THROWN * sizeof(double));
    }
}

/* The variables of stages k, k + 1 ..; of the last one again beyond it. */
static void gather(const struct call *call, const struct block *b, int k, lanes *z) {
    for (int lane = 0; lane < LANES; lane++) {
        const double *from = call->z + WITH_THROWN * (k + lane < b->last ? k + lane : b->last - 1);
        for (int i = 0; i < b->variables; i++) z[i][lane] = from[i];
    }
}

/* The parameters of a block, or those of stages k, k + 1 .. side by side. */
static const void *parameters(const struct call *call, const struct block *b, int k, lanes *apart) {
    const double *p = call->p + b->parameters;
    if (!b->each) return p;
    for (int lane = 0; lane < LANES; lane++)
        for (int i = 0; i < b->each; i++)
            apart[i][lane] = p[b->each * ((k + lane < b->last ? k + lane : b->last - 1) - b->first) + i];
    return apart;
}

#define FOR_LANES(b, k, lane) for (int lane = 0; lane < LANES && k + lane < (b)->last; lane++)

static const int *positions(const struct block *b, int k) { return b->position + b->rows * (k - b->first); }

/* Every row that is the next stage's state. */
#define FOR_FOLLOWING(of, b, k, row)                                              \
    for (const struct block *b = (of)->block; b < (of)->block + (of)->blocks; b++) \
        for (int k = b->first; b->following && k < b->last; k++)                  \
            for (int row = 0; row < b->following; row++)

/* The place of a following row's state in a vector like `z`. */
static double *followed(double *z, const struct block *b, int k, int row) {
    const int i = b->into + row;
    return z + WITH_THROWN * (k + 1) + (i < STATES ? i : i + CONTROLS);
}

static void set_rows(const struct call *call, const struct block *b, int k, const lanes *rows) {
    FOR_LANES(b, k, lane) {
        const int *at = positions(b, k + lane);
        for (int row = 0; row < b->following; row++)
            call->g[at[row]] = *followed(call->z, b, k + lane, row) - rows[row][lane];
        for (int row = b->following; row < b->rows; row++) call->g[at[row]] = 0.0 + rows[row][lane];
    }
}

static void rows_of_all(const struct call *call) {
    const struct problem *of = call->of;
    lanes z[WITH_THROWN], apart[ROWS_MAX], rows[ROWS_MAX];
    for (int i = 0; i < of->blocks; i++) {
        const struct block *b = of->block + i;
        if (i == of->cost) continue;
        for (int k = b->first; k < b->last; k += LANES) {
            gather(call, b, k, z);
            b->value(z, parameters(call, b, k, apart), rows);
            set_rows(call, b, k, rows);
        }
    }
}

/* By how much each bounded row or variable is above its lower bound: an equality's residual. */
static double residual(const struct call *call, int which, int is_equality) {
    const int n = variables(call->of);
    const double value =
        which < n ? call->z[which / VARIABLES * WITH_THROWN + which % VARIABLES] : call->g[which - n];
    return is_equality ? value - call->lower[which] : value;
}

/* Takes numbers of which some are not finite as zeros, and the call as broken: from such derivatives fatrop does not
   return, since it adds to their diagonal until they can be factored. */
static void require_finite(struct call *call, lanes *x, long long n) {
    const lane_bits exponent = (lane_bits)spread(INFINITY);
    lane_bits beyond = {0};
    for (long long i = 0; i < n; i++) beyond |= ((lane_bits)x[i] & exponent) == exponent;
    for (int lane = 0; lane < LANES; lane++)
        if (beyond[lane]) {
            memset(x, 0, (size_t)n * sizeof *x);
            call->broken = 1;
            return;
        }
}

static int violations(const double *primal, const double *stage_p, const double *global_p, double *out, const dims *s,
                      void *data) {
    const struct call *call = data;
    (void)stage_p, (void)global_p;
    read_variables(call, primal, s);
    rows_of_all(call);
    for (int k = 0; k < s->K; k++) {
        for (int i = call->inequalities[k], column = 0; i < call->inequalities[k + 1]; i++, column++)
            out[s->g_ineq_offs[k] + column] = residual(call, call->inequality[i], 0);
        for (int i = call->equalities[k], column = 0; i < call->equalities[k + 1]; i++, column++)
            out[s->g_offs[k] + column] = residual(call, call->equality[i], 1);
    }
    FOR_FOLLOWING(call->of, b, k, row) out[s->dyn_eq_offs[k] + b->into + row] = 0.0 - call->g[positions(b, k)[row]];
    return 1;
}

static void clear(matrix *A, int m, int n) {
    for (int row = 0; row < m; row += 4) memset(A->pA + row * A->cn, 0, sizeof(double) * 4 * (size_t)n);
}

/* The bounded variables of a stage, and the values of its bounded rows in the matrix's last row. */
static void set_bounded(const struct call *call, matrix *A, int k, int first, int last, const int *list,
                        int is_equality) {
    const int n = variables(call->of), free = controls(call->of, k);
    for (int i = first, column = 0; i < last; i++, column++) {
        if (list[i] < n) BLASFEO_DMATEL(A, placed(list[i] - VARIABLES * k, free), column) = 1.0;
        BLASFEO_DMATEL(A, states(call->of, k) + free, column) = residual(call, list[i], is_equality);
    }
}

static int jacobian(const double *primal, const double *stage_p, const double *global_p, matrix *dynamics,
                    matrix *equal, matrix *unequal, const dims *s, void *data) {
    struct call *call = data;
    const struct problem *of = call->of;
    const int n = variables(of);
    lanes z[WITH_THROWN], apart[ROWS_MAX], rows[ROWS_MAX], entries[ENTRIES_MAX];
    (void)stage_p, (void)global_p;
    products = 0;
    read_variables(call, primal, s);
    for (int k = 0; k <= of->stages; k++) {
        const int height = states(of, k) + controls(of, k) + 1;
        if (k < of->stages) clear(dynamics + k, height, states(of, k + 1));
        clear(equal + k, height, s->ng[k]);
        clear(unequal + k, height, s->ng_ineq[k]);
    }
    for (int i = 0; i < of->blocks; i++) {
        const struct block *b = of->block + i;
        const long long *first = b->jacobian + 2, *row = first + b->variables + 1;
        if (i == of->cost) continue;
        for (int k = b->first; k < b->last; k += LANES) {
            gather(call, b, k, z);
            b->slope(z, parameters(call, b, k, apart), rows, entries);
            require_finite(call, rows, b->rows);
            require_finite(call, entries, first[b->variables]);
            set_rows(call, b, k, rows);
            FOR_LANES(b, k, lane) {
                const int *at = positions(b, k + lane), free = controls(of, k + lane);
                for (int j = 0; j < b->variables; j++)
                    for (long long e = first[j]; e < first[j + 1] && exists(of, k + lane, j); e++) {
                        const int column =
                            row[e] < b->following ? b->into + (int)row[e] : call->columns[n + at[row[e]]];
                        matrix *A = (row[e] < b->following ? dynamics : column < 0 ? equal : unequal) + k + lane;
                        if (column != FREE)
                            BLASFEO_DMATEL(A, placed(j, free), column < 0 ? -1 - column : column) =
                                entries[e][lane];
                    }
            }
        }
    }
    for (int k = 0; k <= of->stages; k++) {
        set_bounded(call, equal + k, k, call->equalities[k], call->equalities[k + 1], call->equality, 1);
        set_bounded(call, unequal + k, k, call->inequalities[k], call->inequalities[k + 1], call->inequality, 0);
    }
    FOR_FOLLOWING(of, b, k, row)
        BLASFEO_DMATEL(dynamics + k, states(of, k) + CONTROLS, b->into + row) = 0.0 - call->g[positions(b, k)[row]];
    return 1;
}

/* The multipliers of all rows, as those of x_{k+1} - F, from fatrop's, which are those of F - x_{k+1}. */
static void read_multipliers(const struct call *call, const double *given, const dims *s) {
    const int n = variables(call->of);
    for (int k = 0; k < s->K; k++) {
        for (int i = call->inequalities[k], column = 0; i < call->inequalities[k + 1]; i++, column++)
            call->multipliers[call->inequality[i]] = given[s->g_ineq_offs[k] + column];
        for (int i = call->equalities[k], column = 0; i < call->equalities[k + 1]; i++, column++)
            call->multipliers[call->equality[i]] = given[s->g_offs[k] + column];
    }
    FOR_FOLLOWING(call->of, b, k, row)
        call->multipliers[n + positions(b, k)[row]] = -given[s->dyn_eq_offs[k] + b->into + row];
}

/* A clock [s] that nobody sets. */
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Lets an iteration be the last one. */
static void end(struct call *call, int status) {
    if (!call->ended) call->ended = status;
    fatrop_ocp_c_set_option_int(call->solver, "max_iter", 0);
}

/* What a range adds to a lower bound on what is linear in a number: the least beyond `value`, 0 without an end. */
static double least_within(double slope, double value, double lower, double upper) {
    const double end = slope > 0.0 ? lower : upper;
    return isfinite(end) ? slope * (end - value) : 0.0;
}

/* About the least time of the release, scaled, that a solve can come to; its oracle is in
   tests/planner/backends/casadi_fatrop.py. */
static double least_release(const struct call *call, double scale) {
    const struct problem *of = call->of;
    const double *lower = call->lower, *upper = call->upper;
    const int n = variables(of);
    double sum = 0.0;
    rows_of_all(call);
    for (int i = 0; i < of->rows; i++)
        sum += least_within(-call->multipliers[n + i], call->g[i], lower[n + i], upper[n + i]);
    for (int i = 0; i < core(of); i++) {
        const int at = i / VARIABLES * WITH_THROWN + i % VARIABLES;
        sum += least_within(call->gradient[at], call->z[at], lower[i], upper[i]);
    }
    return sum < 0.0 ? sum / scale - call->z[TIME] : -INFINITY;
}

static int hessian(double scale, const double *primal, const double *given, const double *stage_p,
                   const double *global_p, matrix *out, const dims *s, void *data) {
    struct call *call = data;
    const struct problem *of = call->of;
    const int n = variables(of);
    double *slope = call->gradient;
    lanes z[WITH_THROWN], apart[ROWS_MAX], weights[ROWS_MAX], gradient[WITH_THROWN], entries[WITH_THROWN * WITH_THROWN];
    (void)stage_p, (void)global_p;
    products = 0;
    call->iterations = call->iterations + 1;
    read_variables(call, primal, s);
    read_multipliers(call, given, s);
    memset(slope, 0, WITH_THROWN * (size_t)(of->stages + 1) * sizeof(double));
    for (int k = 0; k <= of->stages; k++)
        clear(out + k, states(of, k) + controls(of, k) + 1, states(of, k) + controls(of, k));
    FOR_FOLLOWING(of, b, k, row) *followed(slope, b, k, row) = 0.0 - given[s->dyn_eq_offs[k] + b->into + row];
    for (int i = 0; i < of->blocks; i++) {
        const struct block *b = of->block + i;
        const long long *first = b->hessian + 2, *row = first + b->variables + 1;
        for (int k = b->first; k < b->last; k += LANES) {
            gather(call, b, k, z);
            for (int lane = 0; lane < LANES; lane++) {
                const int *at = i == of->cost ? 0 : positions(b, k + lane < b->last ? k + lane : b->last - 1);
                for (int r = 0; r < b->rows; r++) {
                    const double weight = at ? call->multipliers[n + at[r]] : scale;
                    weights[r][lane] = r < b->following ? -weight : weight;
                }
            }
            b->curve(z, parameters(call, b, k, apart), weights, gradient, entries);
            require_finite(call, gradient, b->variables);
            require_finite(call, entries, first[b->variables]);
            FOR_LANES(b, k, lane) {
                const int free = controls(of, k + lane);
                for (int j = 0; j < b->variables; j++) {
                    if (!exists(of, k + lane, j)) continue;
                    slope[WITH_THROWN * (k + lane) + j] += gradient[j][lane];
                    for (long long e = first[j]; e < first[j + 1]; e++)
                        if (exists(of, k + lane, (int)row[e]))
                            BLASFEO_DMATEL(out + k + lane, placed((int)row[e], free), placed(j, free)) +=
                                entries[e][lane];
                }
            }
        }
    }
    if (call->latest < INFINITY && least_release(call, scale) > call->latest) end(call, LATE);
    if (call->until < INFINITY && now() >= call->until) end(call, OUT_OF_TIME);
    FOR_FOLLOWING(of, b, k, row) *followed(slope, b, k, row) += given[s->dyn_eq_offs[k] + b->into + row];
    for (int k = 0; k <= of->stages; k++) {
        const int free = controls(of, k);
        double *own = slope + WITH_THROWN * k;
        for (int i = call->inequalities[k], column = 0; i < call->inequalities[k + 1]; i++, column++)
            if (call->inequality[i] < n) own[call->inequality[i] - VARIABLES * k] += given[s->g_ineq_offs[k] + column];
        for (int i = call->equalities[k], column = 0; i < call->equalities[k + 1]; i++, column++)
            if (call->equality[i] < n) own[call->equality[i] - VARIABLES * k] += given[s->g_offs[k] + column];
        for (int j = 0; j < WITH_THROWN; j++)
            if (exists(of, k, j)) BLASFEO_DMATEL(out + k, states(of, k) + free, placed(j, free)) = own[j];
    }
    return 1;
}

static int objective_gradient(double scale, const double *primal, const double *stage_p, const double *global_p,
                              double *out, const dims *s, void *data) {
    struct call *call = data;
    const struct block *b = call->of->block + call->of->cost;
    const long long *first = b->jacobian + 2;
    lanes z[WITH_THROWN], apart[ROWS_MAX], row[ROWS_MAX], entries[VARIABLES];
    (void)stage_p, (void)global_p;
    read_variables(call, primal, s);
    memset(out, 0, (size_t)variables(call->of) * sizeof(double));
    for (int k = b->first; k < b->last; k += LANES) {
        gather(call, b, k, z);
        b->slope(z, parameters(call, b, k, apart), row, entries);
        require_finite(call, entries, first[VARIABLES]);
        FOR_LANES(b, k, lane)
            for (int j = 0; j < VARIABLES; j++)
                for (long long e = first[j]; e < first[j + 1]; e++)
                    out[s->ux_offs[k + lane] + placed(j, CONTROLS)] = scale * entries[e][lane];
    }
    return 1;
}

static int objective(double scale, const double *primal, const double *stage_p, const double *global_p, double *out,
                     const dims *s, void *data) {
    const struct call *call = data;
    const struct block *b = call->of->block + call->of->cost;
    lanes z[WITH_THROWN], apart[ROWS_MAX], row[ROWS_MAX];
    double sum = 0.0;
    (void)stage_p, (void)global_p;
    read_variables(call, primal, s);
    for (int k = b->first; k < b->last; k += LANES) {
        gather(call, b, k, z);
        b->value(z, parameters(call, b, k, apart), row);
        FOR_LANES(b, k, lane) sum += row[0][lane];
    }
    *out = scale * sum;
    return 1;
}

static int states_of(int k, void *data) { return states(((struct call *)data)->of, k); }
static int controls_of(int k, void *data) { return controls(((struct call *)data)->of, k); }
static int horizon(void *data) { return ((struct call *)data)->of->stages + 1; }

static int equalities_of(int k, void *data) {
    const struct call *call = data;
    return call->equalities[k + 1] - call->equalities[k];
}

static int inequalities_of(int k, void *data) {
    const struct call *call = data;
    return call->inequalities[k + 1] - call->inequalities[k];
}

static int bounds_of(double *lower, double *upper, int k, void *data) {
    const struct call *call = data;
    for (int i = call->inequalities[k]; i < call->inequalities[k + 1]; i++) {
        *lower++ = call->lower[call->inequality[i]];
        *upper++ = call->upper[call->inequality[i]];
    }
    return 0;
}

static int guessed_state(double *x, int k, void *data) {
    const struct call *call = data;
    memcpy(x, call->guess + VARIABLES * k, STATES * sizeof(double));
    if (has_thrown(call->of, k)) memcpy(x + STATES, call->guess + first_thrown(call->of, k), THROWN * sizeof(double));
    return 0;
}

static int guessed_control(double *u, int k, void *data) {
    const struct call *call = data;
    memcpy(u, call->guess + VARIABLES * k + STATES, (size_t)controls(call->of, k) * sizeof(double));
    return 0;
}

/* Sorts a range of rows or variables into equalities, inequalities and those without bounds. */
static void sort(struct call *call, int k, int first, int last) {
    for (int i = first; i < last; i++) {
        call->columns[i] = FREE;
        if (call->lower[i] == call->upper[i]) {
            call->columns[i] = -1 - (call->equalities[k + 1] - call->equalities[k]);
            call->equality[call->equalities[k + 1]++] = i;
        } else if (call->lower[i] > -INFINITY || call->upper[i] < INFINITY) {
            call->columns[i] = call->inequalities[k + 1] - call->inequalities[k];
            call->inequality[call->inequalities[k + 1]++] = i;
        }
    }
}

static void ignore(const char *text, int length) { (void)text, (void)length; }

/* Whether all rows are finite at the guess. */
static int begins_finite(struct call *call) {
    const int n = variables(call->of);
    int all = 1;
    unpack(call->of, call->guess, call->z);
    rows_of_all(call);
    for (int i = 0; i < n; i++) all &= isfinite(call->guess[i]);
    for (int i = 0; i < call->of->rows; i++) all &= isfinite(call->g[i]);
    return all;
}

/* Solves a launch; sets the variables and the number of iterations. Returns fatrop's status: 0 for solved;
   BROKEN where it cannot begin, some derivative was not finite, or it does not return; LATE where it was ended as it
   comes to no release by `latest`; OUT_OF_TIME where it took longer than `seconds`.

   `lower`, `upper`: of the variables, then of the rows; `p`: every block's parameters, then the costs'; `latest`: time
   of the release, scaled, INFINITY for none; `names` and `values` of fatrop's options; `seconds`: INFINITY for no end. */
int solve_launch(const struct problem *of, const double *lower, const double *upper, const double *guess,
                 const double *p, double latest, int options, const char *const *names, const double *values,
                 double *out, int *iterations, double seconds) {
    const int n = variables(of), padded = WITH_THROWN * (of->stages + 1), all = n + of->rows;
    double *numbers = calloc((size_t)(2 * padded + of->rows + all), sizeof(double));
    int *counts = calloc((size_t)(3 * all + 2 * (of->stages + 2)), sizeof(int));
    struct call call = {.of = of, .lower = lower, .upper = upper, .guess = guess, .p = p, .latest = latest};
    call.until = now() + seconds;
    int status = BROKEN;
    if (!numbers || !counts) goto end;
    call.z = numbers, call.gradient = call.z + padded, call.g = call.gradient + padded, call.multipliers = call.g + of->rows;
    call.columns = counts, call.inequality = call.columns + all, call.equality = call.inequality + all;
    call.inequalities = call.equality + all, call.equalities = call.inequalities + of->stages + 2;
    for (int k = 0; k <= of->stages; k++) {
        call.inequalities[k + 1] = call.inequalities[k], call.equalities[k + 1] = call.equalities[k];
        sort(&call, k, n + of->own[k], n + of->own[k] + of->owned[k]);
        sort(&call, k, VARIABLES * k, VARIABLES * k + STATES + controls(of, k));
    }
    if (!begins_finite(&call)) goto end;
    struct FatropOcpCInterface interface = {
        .get_nx = states_of, .get_nu = controls_of, .get_ng = equalities_of, .get_ng_ineq = inequalities_of,
        .get_horizon_length = horizon, .get_bounds = bounds_of,
        .get_initial_xk = guessed_state, .get_initial_uk = guessed_control,
        .full_eval_lag_hess = hessian, .full_eval_constr_jac = jacobian, .full_eval_contr_viol = violations,
        .full_eval_obj_grad = objective_gradient, .full_eval_obj = objective,
        .user_data = &call,
    };
    struct FatropOcpCSolver *solver = fatrop_ocp_c_create(&interface, ignore, 0);
    call.solver = solver;
    for (int i = 0; i < options; i++)
        if (fatrop_ocp_c_option_type(names[i]) == 1)
            fatrop_ocp_c_set_option_int(solver, names[i], (int)values[i]);
        else
            fatrop_ocp_c_set_option_double(solver, names[i], values[i]);
    jmp_buf here;
    if (setjmp(here) == 0) {
        leave = &here, products = 0;
        status = fatrop_ocp_c_solve(solver);
        *iterations = call.ended ? call.iterations : fatrop_ocp_c_get_stats(solver)->iterations_count;
    } else { /* past fatrop's destructors, deliberately: what they would have freed is lost */
        call.broken = 1;
        *iterations = call.iterations;
    }
    leave = NULL;
    if (call.ended) status = call.ended;
    if (call.broken) status = BROKEN;
    read_variables(&call, fatrop_ocp_c_get_primal(solver)->pa, fatrop_ocp_c_get_dims(solver));
    pack(of, call.z, out);
    fatrop_ocp_c_destroy(solver);
end:
    free(numbers);
    free(counts);
    return status;
}

/* Sets the rows (rows,) at variables `x`. */
void launch_rows(const struct problem *of, const double *x, const double *p, double *rows) {
    double *z = calloc((size_t)(WITH_THROWN * (of->stages + 1)), sizeof(double));
    const struct call call = {.of = of, .p = p, .z = z, .g = rows};
    if (!z) return;
    unpack(of, x, z);
    rows_of_all(&call);
    free(z);
}
