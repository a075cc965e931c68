/* Numbers of several stages side by side: every operation applies to all of them at once.

   Each stage's numbers are those that the same operations give alone, to the last bit. Two doubles fill a register of
   any x86-64 processor. */

#include <math.h>

#define LANES 2

/* Before a part of a function: a whole one would take the compiler minutes. */
#define PART static __attribute__((noinline))

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long lane_bits __attribute__((vector_size(8 * LANES)));

static inline lanes spread(double x) { return (lanes){x, x}; }

static inline lanes sin_lanes(lanes x) { return (lanes){sin(x[0]), sin(x[1])}; }
static inline lanes cos_lanes(lanes x) { return (lanes){cos(x[0]), cos(x[1])}; }
static inline lanes exp_lanes(lanes x) { return (lanes){exp(x[0]), exp(x[1])}; }
static inline lanes log_lanes(lanes x) { return (lanes){log(x[0]), log(x[1])}; }
static inline lanes sqrt_lanes(lanes x) { return (lanes){sqrt(x[0]), sqrt(x[1])}; }
static inline lanes fabs_lanes(lanes x) { return (lanes)((lane_bits)x & 0x7fffffffffffffffLL); }

static inline lanes chosen(lane_bits where, lanes x, lanes y) {
    return (lanes)(((lane_bits)x & where) | ((lane_bits)y & ~where));
}

/* As fmin and fmax: the other number where one is none. */
static inline lanes fmin_lanes(lanes x, lanes y) { return chosen((x < y) | (y != y), x, y); }
static inline lanes fmax_lanes(lanes x, lanes y) { return chosen((x > y) | (y != y), x, y); }

static inline double less(double x, double y) { return x < y; }
static inline lanes less_lanes(lanes x, lanes y) { return chosen(x < y, spread(1.0), spread(0.0)); }
