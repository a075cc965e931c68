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

/* Functions of the C library, number by number. Its code may be of the older instructions, which wait where the upper
   halves of the newer registers are in use: 0.1 us a call on a Xeon. So they are called where none is. */
#define CALLED(function) \
    static __attribute__((noinline, unused)) void function##_of_each(const double *x, double *y) { \
        LEAVE_LANES(); \
        for (int lane = 0; lane < LANES; lane++) y[lane] = function(x[lane]); \
    } \
    static inline lanes function##_lanes(lanes x) { \
        lanes y; \
        function##_of_each((const double *)&x, (double *)&y); \
        return y; \
    }
CALLED(sin)
CALLED(cos)
CALLED(exp)
CALLED(log)

#define ROOT(lane) sqrt(x[lane])
static inline lanes sqrt_lanes(lanes x) { return (lanes)OF_EACH(ROOT); }

static inline lanes fabs_lanes(lanes x) { return (lanes)((lane_bits)x & 0x7fffffffffffffffLL); }

static inline lanes chosen(lane_bits where, lanes x, lanes y) {
    return (lanes)(((lane_bits)x & where) | ((lane_bits)y & ~where));
}

/* As fmin and fmax: the other number where one is none. */
static inline lanes fmin_lanes(lanes x, lanes y) { return chosen((x < y) | (y != y), x, y); }
static inline lanes fmax_lanes(lanes x, lanes y) { return chosen((x > y) | (y != y), x, y); }

static inline double less(double x, double y) { return x < y; }
static inline lanes less_lanes(lanes x, lanes y) { return chosen(x < y, spread(1.0), spread(0.0)); }
