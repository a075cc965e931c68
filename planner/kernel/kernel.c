/* Poses, torques and distances of an arm at many instants: compiled twins of numpy functions.

   Each function does what the numpy function of the same name does, in the same order, and is compared with it when it
   is loaded (twin.py). Arrays are contiguous doubles; n counts instants. A NaN that goes in comes out, so that what
   cannot be evaluated fails its check. */

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

typedef ptrdiff_t count;
typedef const double *in;

static double dot(in a, in b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void add_cross(in a, in b, double *out) {
    out[0] += a[1] * b[2] - a[2] * b[1];
    out[1] += a[2] * b[0] - a[0] * b[2];
    out[2] += a[0] * b[1] - a[1] * b[0];
}

static double clamped(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* Poses X (n, 7, 4, 4) of base and links; cosines and sines (n, 6) of the joints, dh: a, d, cos alpha, sin alpha. */
void link_poses(count n, in cosine, in sine, in dh, in base, double *X) {
    memset(X, 0, n * 7 * 16 * sizeof *X);
    for (count k = 0; k < n; k++, cosine += 6, sine += 6, X += 7 * 16) {
        memcpy(X, base, 16 * sizeof *X);
        for (int i = 0; i < 6; i++) {
            double a = dh[i], d = dh[6 + i], c = dh[12 + i], s = dh[18 + i];
            for (int row = 0; row < 3; row++) {
                in from = X + 16 * i + 4 * row;
                double *to = X + 16 * (i + 1) + 4 * row;
                double turned = cosine[i] * from[1] - sine[i] * from[0];
                to[0] = cosine[i] * from[0] + sine[i] * from[1];
                to[1] = c * turned + s * from[2];
                to[2] = c * from[2] - s * turned;
                to[3] = from[3] + d * from[2] + a * to[0];
            }
            X[16 * (i + 1) + 15] = 1.0;
        }
    }
}

/* The same for a measured chain: between the rotations of the joints the fixed transforms (6, 4, 4). */
void fixed_chain_poses(count n, in cosine, in sine, in fixed, in base, double *X) {
    memset(X, 0, n * 7 * 16 * sizeof *X);
    for (count k = 0; k < n; k++, cosine += 6, sine += 6, X += 7 * 16) {
        memcpy(X, base, 16 * sizeof *X);
        for (int i = 0; i < 6; i++) {
            in M = fixed + 16 * i;
            for (int row = 0; row < 3; row++) {
                in from = X + 16 * i + 4 * row;
                double *to = X + 16 * (i + 1) + 4 * row;
                double x = cosine[i] * from[0] + sine[i] * from[1];
                double y = cosine[i] * from[1] - sine[i] * from[0];
                for (int column = 0; column < 4; column++)
                    to[column] = x * M[column] + y * M[4 + column] + from[2] * M[8 + column];
                to[3] += from[3];
            }
            X[16 * (i + 1) + 15] = 1.0;
        }
    }
}

/* A point of a frame, or with translation 0 a direction, in the world. */
static void in_world(in X, in p, double translation, double *out) {
    for (int row = 0; row < 3; row++) out[row] = dot(X + 4 * row, p) + translation * X[4 * row + 3];
}

/* Ends (k, 2, 3, n) in the world of k segments with ends (k, 2, 3) in their frames. */
void end_points(count n, in X, count k, const count *frames, in ends, double *out) {
    for (count i = 0; i < 2 * k; i++)
        for (count m = 0; m < n; m++) {
            double p[3];
            in_world(X + 16 * (7 * m + frames[i / 2]), ends + 3 * i, 1.0, p);
            for (int row = 0; row < 3; row++) out[(3 * i + row) * n + m] = p[row];
        }
}

/* Ends (n, 2, 3) in the world of one segment an instant, given in its frame (n, 2, 3). */
void end_points_of(count n, in X, const count *frames, in ends, double *out) {
    for (count i = 0; i < 2 * n; i++) in_world(X + 16 * (7 * (i / 2) + frames[i / 2]), ends + 3 * i, 1.0, out + 3 * i);
}

/* Largest sizes (c, k - 1) of values (n, c) from each of k rows to the next, which is among them if `closed` is 1. */
void largest_between(count c, in values, count k, const count *rows, count closed, double *out) {
    for (count i = 0; i + 1 < k; i++)
        for (count j = 0; j < c; j++) {
            double most = 0.0;
            for (count row = rows[i]; row < rows[i + 1] + closed; row++) {
                double size = fabs(values[c * row + j]);
                if (size > most || size != size) most = size;
            }
            out[j * (k - 1) + i] = most;
        }
}

/* Velocities (3, n) of a point (3, n) that moves with the flange. */
void point_velocity(count n, in X, in qd, in point, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6) {
        double v[3] = {0.0};
        for (int i = 0; i < 6; i++) {
            double turn[3], arm[3];
            for (int row = 0; row < 3; row++) {
                turn[row] = X[16 * i + 4 * row + 2] * qd[i];
                arm[row] = point[row * n + m] - X[16 * i + 4 * row + 3];
            }
            add_cross(turn, arm, v);
        }
        for (int row = 0; row < 3; row++) out[row * n + m] = v[row];
    }
}

/* Adds the acceleration of a point r beyond the origin of its link: alpha x r + omega x (omega x r). */
static void add_relative(in omega, in alpha, in r, double *out) {
    double v[3] = {0.0};
    add_cross(omega, r, v);
    add_cross(alpha, r, out);
    add_cross(omega, v, out);
}

/* The arm at one instant. */
struct chain {
    double axis[6][3], origin[7][3]; /* of the joints; of the frames */
    double force[6][3], moment[6][3]; /* on each link, the moment about the world's origin */
    double omega[3], alpha[3], acceleration[3]; /* of the link reached so far, and of its frame's origin */
};

/* Mass properties of the links: mass (6,), centre of mass and principal axes fixed (4, 6, 3), inertia about these. */
struct bodies {
    in mass, fixed, principal;
};

/* Adds the moment of link i about its centre of mass: I alpha + omega x I omega. */
static void add_turning(const struct bodies *of, int i, in frame, struct chain *at) {
    double inertia_omega[3] = {0.0};
    for (int k = 0; k < 3; k++) {
        double axis[3], inertia = of->principal[6 * k + i];
        in_world(frame, of->fixed + 18 * (k + 1) + 3 * i, 0.0, axis);
        double spin = inertia * dot(axis, at->omega), gain = inertia * dot(axis, at->alpha);
        for (int row = 0; row < 3; row++) {
            inertia_omega[row] += axis[row] * spin;
            at->moment[i][row] += axis[row] * gain;
        }
    }
    add_cross(at->omega, inertia_omega, at->moment[i]);
}

/* Goes on to link i, from the base outwards: its motion, and what moves it. */
static void outwards(const struct bodies *of, int i, in frame, double qd, double qdd, struct chain *at) {
    double turn[3], offset[3], com[3], place[3];
    for (int row = 0; row < 3; row++) {
        turn[row] = at->axis[i][row] * qd;
        at->omega[row] += turn[row];
        at->alpha[row] += at->axis[i][row] * qdd;
        offset[row] = at->origin[i + 1][row] - at->origin[i][row];
    }
    add_cross(at->omega, turn, at->alpha);
    add_relative(at->omega, at->alpha, offset, at->acceleration);
    in_world(frame, of->fixed + 3 * i, 0.0, com);
    memcpy(at->force[i], at->acceleration, sizeof at->force[i]);
    add_relative(at->omega, at->alpha, com, at->force[i]);
    for (int row = 0; row < 3; row++) {
        at->force[i][row] *= of->mass[i];
        place[row] = at->origin[i + 1][row] + com[row];
    }
    memset(at->moment[i], 0, sizeof at->moment[i]);
    add_turning(of, i, frame, at);
    add_cross(place, at->force[i], at->moment[i]);
}

/* Adds the load beyond joint i to it, from the tip inwards; returns the joint's torque. */
static double inwards(int i, struct chain *at) {
    double about[3] = {0.0}, load[3];
    for (int row = 0; row < 3 && i < 5; row++) {
        at->force[i][row] += at->force[i + 1][row];
        at->moment[i][row] += at->moment[i + 1][row];
    }
    add_cross(at->origin[i], at->force[i], about);
    for (int row = 0; row < 3; row++) load[row] = at->moment[i][row] - about[row];
    return dot(at->axis[i], load);
}

/* The torque of joint i per kilogram of a point mass at `point`, which has the acceleration reached. */
static double of_point(int i, in point, const struct chain *at) {
    double arm[3], moment[3] = {0.0};
    for (int row = 0; row < 3; row++) arm[row] = point[row] - at->origin[i][row];
    add_cross(arm, at->acceleration, moment);
    return dot(at->axis[i], moment);
}

/* Torques (6, n) of bodies, and per kilogram of a point mass at p_F on the flange (6, n), by Newton and Euler. */
void chain_torques(count n, in X, in qd, in qdd, in mass, in fixed, in principal, in upward, in p_F, double *tau,
                   double *per_kilogram) {
    const struct bodies of = {mass, fixed, principal};
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6, qdd += 6) {
        struct chain at = {.acceleration = {upward[0], upward[1], upward[2]}};
        double tip[3], point[3];
        for (int i = 0; i < 7; i++)
            for (int row = 0; row < 3; row++) {
                at.origin[i][row] = X[16 * i + 4 * row + 3];
                if (i < 6) at.axis[i][row] = X[16 * i + 4 * row + 2];
            }
        for (int i = 0; i < 6; i++) outwards(&of, i, X + 16 * (i + 1), qd[i], qdd[i], &at);
        in_world(X + 16 * 6, p_F, 0.0, tip);
        in_world(X + 16 * 6, p_F, 1.0, point);
        add_relative(at.omega, at.alpha, tip, at.acceleration);
        for (int i = 5; i >= 0; i--) {
            tau[i * n + m] = inwards(i, &at);
            per_kilogram[i * n + m] = of_point(i, point, &at);
        }
    }
}

/* Distances (p, n) of p pairs (p, 2) of segments with ends (k, 2, 3, n). Source: see segment_segment_distance. */
void pair_distances(count n, in ends, count p, const count *pairs, double shortest, double *out) {
    for (count i = 0; i < p; i++)
        for (count m = 0; m < n; m++) {
            in one = ends + 6 * n * pairs[2 * i] + m, other = ends + 6 * n * pairs[2 * i + 1] + m;
            double u[3], v[3], w[3], gap[3];
            for (int row = 0; row < 3; row++, one += n, other += n) {
                u[row] = one[3 * n] - one[0];
                v[row] = other[3 * n] - other[0];
                w[row] = other[0] - one[0];
            }
            double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
            double determinant = uu * vv - uv * uv;
            double s = determinant > DBL_EPSILON * uu * vv ? (vv * uw - uv * vw) / determinant : 0.0;
            double t = clamped((clamped(s, 0.0, 1.0) * uv - vw) / (vv > shortest ? vv : shortest), 0.0, 1.0);
            s = clamped((uw + t * uv) / (uu > shortest ? uu : shortest), 0.0, 1.0);
            for (int row = 0; row < 3; row++) gap[row] = w[row] + t * v[row] - s * u[row];
            out[i * n + m] = sqrt(dot(gap, gap));
        }
}

/* The vector from the closest point of a box to the point at a share of the segment from p0 along `along`. */
static void outside(in p0, in along, double share, in lower, in upper, double *gap) {
    for (int row = 0; row < 3; row++) {
        double p = p0[row] + share * along[row];
        gap[row] = p - clamped(p, lower[row], upper[row]);
    }
}

/* Distances (n,) of segments p0-p1 from boxes, each (n, 3). See segment_box_distance. */
void box_distances(count n, in p0, in p1, in lower, in upper, double *out) {
    for (count m = 0; m < n; m++, p0 += 3, p1 += 3, lower += 3, upper += 3) {
        double along[3], gap[3], knots[8] = {0.0, 1.0}, slopes[8];
        for (int row = 0; row < 3; row++) {
            along[row] = p1[row] - p0[row];
            double moving = along[row] != 0.0 ? along[row] : INFINITY;
            knots[2 + row] = clamped((lower[row] - p0[row]) / moving, 0.0, 1.0);
            knots[5 + row] = clamped((upper[row] - p0[row]) / moving, 0.0, 1.0);
        }
        for (int i = 1; i < 8; i++)
            for (int j = i; j > 0 && knots[j] < knots[j - 1]; j--) {
                double swapped = knots[j];
                knots[j] = knots[j - 1];
                knots[j - 1] = swapped;
            }
        int after = 0;
        for (int i = 0; i < 8; i++) {
            outside(p0, along, knots[i], lower, upper, gap);
            slopes[i] = dot(gap, along);
            after += slopes[i] < 0.0;
        }
        after = after < 1 ? 1 : after > 7 ? 7 : after;
        double rise = slopes[after] - slopes[after - 1], t = knots[after - 1];
        double share = rise > 0.0 ? clamped(-slopes[after - 1] / rise, 0.0, 1.0) : 0.0;
        outside(p0, along, t + share * (knots[after] - t), lower, upper, gap);
        out[m] = sqrt(dot(gap, gap));
    }
}

/* Rate of a flight's state: position and velocity (6,), under gravity and the drag k |v| v. */
static void flight_rate(in state, double gravity, double drag, double *out) {
    in v = state + 3;
    double slowing = drag * sqrt(dot(v, v));
    for (int row = 0; row < 3; row++) {
        out[row] = v[row];
        out[3 + row] = -slowing * v[row];
    }
    out[5] -= gravity;
}

/* One Runge-Kutta step of a flight's state (6,). See planner/flight.py. */
static void flight_step(in from, double h, double gravity, double drag, double *to) {
    double k[4][6], between[6];
    flight_rate(from, gravity, drag, k[0]);
    for (int stage = 1; stage < 4; stage++) {
        double share = stage < 3 ? 0.5 * h : h;
        for (int row = 0; row < 6; row++) between[row] = from[row] + share * k[stage - 1][row];
        flight_rate(between, gravity, drag, k[stage]);
    }
    for (int row = 0; row < 6; row++)
        to[row] = from[row] + h / 6.0 * (k[0][row] + 2.0 * k[1][row] + 2.0 * k[2][row] + k[3][row]);
}

/* Positions (n, k, 3) of n flights from states (n, 6), each after k times in a row: in steps[j] steps of h (n, k). */
void drag_paths(count n, in states, count k, const count *steps, in h, double gravity, double drag, double *out) {
    for (count m = 0; m < n; m++, states += 6, h += k) {
        double state[6];
        memcpy(state, states, sizeof state);
        for (count j = 0; j < k; j++, out += 3) {
            for (count i = 0; i < steps[j]; i++) flight_step(state, h[j], gravity, drag, state);
            memcpy(out, state, 3 * sizeof *out);
        }
    }
}

/* The time within one step of h at which a component of a flight's state falls through a level, by bisection. */
static double falls_through(in state, int component, double level, double h, double gravity, double drag) {
    double low = 0.0, high = h, after[6];
    for (int i = 0; i < 50; i++) {
        double middle = 0.5 * (low + high);
        flight_step(state, middle, gravity, drag, after);
        if (after[component] > level) low = middle;
        else high = middle;
    }
    return 0.5 * (low + high);
}

/* State at the landing, time and apex (n, 8) of flights from states (n, 6); NaN where they miss the plane. */
void drag_landings(count n, in states, double plane_z, double h, double longest, double gravity, double drag,
                   double *out) {
    for (count m = 0; m < n; m++, states += 6, out += 8) {
        double state[6], next[6], t = 0.0, apex = states[2];
        memcpy(state, states, sizeof state);
        for (int i = 0; i < 8; i++) out[i] = NAN;
        for (; t < longest; t += h) {
            flight_step(state, h, gravity, drag, next);
            if (state[5] > 0.0 && next[5] <= 0.0) {
                double top[6];
                flight_step(state, falls_through(state, 5, 0.0, h, gravity, drag), gravity, drag, top);
                apex = top[2];
            }
            if (next[5] < 0.0 && next[2] < plane_z) {
                if (state[2] < plane_z) break;
                double rest = falls_through(state, 2, plane_z, h, gravity, drag);
                flight_step(state, rest, gravity, drag, out);
                out[2] = plane_z;
                out[6] = t + rest;
                out[7] = apex;
                break;
            }
            memcpy(state, next, sizeof state);
        }
    }
}
