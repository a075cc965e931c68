/* What the kernel's files share. Arrays are contiguous doubles. */

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

typedef ptrdiff_t count;
typedef const double *in;

static inline double dot(in a, in b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void add_cross(in a, in b, double *out) {
    out[0] += a[1] * b[2] - a[2] * b[1];
    out[1] += a[2] * b[0] - a[0] * b[2];
    out[2] += a[0] * b[1] - a[1] * b[0];
}

static inline double clamped(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* A point of a frame, or with translation 0 a direction, in the world. */
static inline void in_world(in X, in p, double translation, double *out) {
    for (int row = 0; row < 3; row++) out[row] = dot(X + 4 * row, p) + translation * X[4 * row + 3];
}

/* Of arm.c. */
void fixed_chain_poses(count n, in cosine, in sine, in fixed, in base, double *X);
double segment_distance(in u, in v, in w, double shortest);
void in_shape(in shape, in p, double *out);
double shape_distance(in shape, in p0, in p1);
