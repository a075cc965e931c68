/* Numbers of several stages side by side: every operation applies to all of them at once.

   Each stage's numbers are those that the same operations give alone, to the last bit. */

#include <math.h>

#ifdef __AVX2__
#define LANES 4
#include <immintrin.h>
#define LEAVE_LANES() _mm256_zeroupper() /* without it, what is called next waits where it uses older instructions */
#else
#define LANES 2
#define LEAVE_LANES()
#endif

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long lane_bits __attribute__((vector_size(8 * LANES)));

#if LANES == 4
#define OF_EACH(expression) {expression(0), expression(1), expression(2), expression(3)}
#else
#define OF_EACH(expression) {expression(0), expression(1)}
#endif

static inline lanes spread(double x) {
#define SAME(lane) x
    return (lanes)OF_EACH(SAME);
}

#define ARGUMENT(lane) FUNCTION(x[lane])
#define FUNCTION sin
static inline lanes sin_lanes(lanes x) { return (lanes)OF_EACH(ARGUMENT); }
#undef FUNCTION
#define FUNCTION cos
static inline lanes cos_lanes(lanes x) { return (lanes)OF_EACH(ARGUMENT); }
#undef FUNCTION
#define FUNCTION exp
static inline lanes exp_lanes(lanes x) { return (lanes)OF_EACH(ARGUMENT); }
#undef FUNCTION
#define FUNCTION log
static inline lanes log_lanes(lanes x) { return (lanes)OF_EACH(ARGUMENT); }
#undef FUNCTION
#define FUNCTION sqrt
static inline lanes sqrt_lanes(lanes x) { return (lanes)OF_EACH(ARGUMENT); }
#undef FUNCTION

static inline lanes fabs_lanes(lanes x) { return (lanes)((lane_bits)x & 0x7fffffffffffffffLL); }

static inline lanes chosen(lane_bits where, lanes x, lanes y) {
    return (lanes)(((lane_bits)x & where) | ((lane_bits)y & ~where));
}

/* As fmin and fmax: the other number where one is none. */
static inline lanes fmin_lanes(lanes x, lanes y) { return chosen((x < y) | (y != y), x, y); }
static inline lanes fmax_lanes(lanes x, lanes y) { return chosen((x > y) | (y != y), x, y); }
