/* The object's flight: with drag, out of the tool, and past the arm.

   See planner/flight.py, and exits.py and flight/patches.py of planner/certificate. */

#include "vectors.h"

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

/* w in the tool frame (3, n), for poses X (n, 4, 4) of the flange, the tool in the flange X_FT (4, 4), the object fallen to (3, n)
   after s (n,), and what the gripper felt (3, n) at the release. */
void ways(count n, in X, in X_FT, in fallen, in s, in felt, double *out) {
    const double place[3] = {X_FT[3], X_FT[7], X_FT[11]};
    for (count m = 0; m < n; m++) {
        in flange = X + 16 * m;
        double p[3], w[3], along[3];
        in_world(flange, place, 1.0, p);
        for (int row = 0; row < 3; row++)
            w[row] = s[m] > 0.0 ? (fallen[row * n + m] - p[row]) * (2.0 / (s[m] * s[m])) : -felt[row * n + m];
        for (int column = 0; column < 3; column++) {
            const double axis[3] = {X_FT[column], X_FT[4 + column], X_FT[8 + column]};
            in_world(flange, axis, 0.0, along);
            out[column * n + m] = dot(along, w);
        }
    }
}

/* The angle of a vector from an axis. */
static double angle_from(in axis, in w) {
    double along = dot(axis, w), across = dot(w, w) - along * along;
    return atan2(sqrt(across < 0.0 ? 0.0 : across), along);
}

static double at_least(double x, double least) { return x < least ? least : x; }

/* A lower bound on how far the corners are outside of what a wide cone leaves out. See exits.py, _outside. */
static double outside_of(in axis, double half, double w[4][3]) {
    const double tiny = 1e-9;
    double middle[3], across[3], away[3], least = INFINITY;
    for (int row = 0; row < 3; row++) middle[row] = w[0][row] + w[1][row] + w[2][row] + w[3][row];
    double along = dot(axis, middle), length = at_least(sqrt(dot(middle, middle)), tiny);
    for (int row = 0; row < 3; row++) across[row] = middle[row] - axis[row] * along;
    double off = at_least(sqrt(dot(across, across)), tiny), sine = sin(half), cosine = cos(half);
    int at_tip = angle_from(axis, middle) <= half - 0.5 * M_PI;
    for (int row = 0; row < 3; row++)
        away[row] = at_tip ? middle[row] / length : sine * axis[row] - cosine * (across[row] / off);
    for (int i = 0; i < 4; i++) {
        double deep = dot(away, w[i]);
        if (deep < least || deep != deep) least = deep;
    }
    return least;
}

/* For k cells with corners (4, k) among p points, with w (3, p) and s (p,), and at most the deviation (k,) between them
   (7, k): angles from the axis (3,) at the corners and where the object gets out, room, whether it is out. Up to
   free_m from its place the object counts in no direction. */
void exit_cells(count p, in w, in s, count k, const count *corners, in deviation, in axis, double half, double free_m,
                double out_m, double *out) {
    const double tiny = 1e-9;
    for (count m = 0; m < k; m++) {
        double v[4][3], size[4], angle[4], root[4], leaving = -INFINITY, room = INFINITY, mean[3];
        double most = 0.0, latest = 0.0;
        int is_out[4];
        for (int i = 0; i < 4; i++) {
            count at = corners[i * k + m];
            for (int row = 0; row < 3; row++) v[i][row] = w[row * p + at];
            size[i] = sqrt(dot(v[i], v[i]));
            double moved = 0.5 * size[i] * s[at] * s[at];
            root[i] = sqrt(moved);
            angle[i] = angle_from(axis, v[i]);
            is_out[i] = moved >= out_m;
            out[i * k + m] = is_out[i] || moved < free_m ? -INFINITY : angle[i];
            most = at_least(size[i], most);
            latest = at_least(s[at], latest);
            double deep = size[i] * sin(at_least(half - angle[i], -0.5 * M_PI));
            if (deep < room || deep != deep) room = deep;
        }
        for (int i = 0; i < 4; i += 2) {
            if (!is_out[i + 1] || is_out[i]) continue;
            double share = (sqrt(out_m) - root[i]) / at_least(root[i + 1] - root[i], tiny), there[3];
            for (int row = 0; row < 3; row++) there[row] = v[i][row] + share * (v[i + 1][row] - v[i][row]);
            leaving = at_least(angle_from(axis, there), leaving);
        }
        for (int row = 0; row < 3; row++) mean[row] = v[0][row] + v[2][row];
        double first = dot(v[0], mean), last = dot(v[2], mean), begin = s[corners[m]];
        double least = (first < last ? first : last) / at_least(sqrt(dot(mean, mean)), tiny);
        out[4 * k + m] = leaving;
        int in_place = 0.5 * (most + deviation[m]) * (latest * latest) < free_m;
        out[5 * k + m] = in_place ? INFINITY : (half > 0.5 * M_PI ? outside_of(axis, half, v) : room) - deviation[m];
        out[6 * k + m] = 0.5 * (least - deviation[m]) * (begin * begin) >= out_m;
    }
}

/* A grid of rows of releases and columns of instants; the patches between them, with one row only where it is single. */
struct grid {
    count rows, columns, patch_rows;
    const double *local; /* positions in the frames (7, rows, columns, 3) */
};

/* The corners of a patch in a frame: two of a single release, four otherwise. Returns their number. */
static int corners_of(const struct grid *on, int frame, count row, count column, in *corners) {
    int number = on->rows > 1 ? 4 : 2;
    for (int i = 0; i < number; i++)
        corners[i] = on->local + 3 * ((frame * on->rows + row + i / 2) * on->columns + column + i % 2);
    return number;
}

/* The point of a segment (2, 3) that is nearest to x, what is between the two, and its length, which is returned. */
static double nearest_on(in segment, in x, double *near, double *apart) {
    const double tiny = 1e-12;
    double along[3], off[3];
    for (int row = 0; row < 3; row++) {
        along[row] = segment[3 + row] - segment[row];
        off[row] = x[row] - segment[row];
    }
    double square = dot(along, along), share = dot(off, along) / (square < tiny * tiny ? tiny * tiny : square);
    share = clamped(share, 0.0, 1.0);
    for (int row = 0; row < 3; row++) {
        near[row] = segment[row] + share * along[row];
        apart[row] = x[row] - near[row];
    }
    return sqrt(dot(apart, apart));
}

/* The least n . (corner - near) over the corners, with n the direction from the nearest point of a segment (2, 3) to
   their mean. See segment_bound. */
static double apart_from(in segment, int number, in *corners) {
    const double tiny = 1e-12;
    double mean[3] = {0.0}, near[3], apart[3], least = INFINITY;
    for (int row = 0; row < 3; row++) {
        for (int i = 0; i < number; i++) mean[row] += corners[i][row];
        mean[row] /= number;
    }
    double length = nearest_on(segment, mean, near, apart);
    for (int i = 0; i < number; i++) {
        double reach = dot(apart, corners[i]);
        if (reach < least || reach != reach) least = reach;
    }
    return (least - dot(apart, near)) / (length < tiny ? tiny : length);
}

/* A place whose coordinates are a stride apart, in the axes of a pose (4, 4). */
static void in_frame(in pose, in x, count stride, double *local) {
    double apart[3];
    for (int row = 0; row < 3; row++) apart[row] = x[row * stride] - pose[4 * row + 3];
    for (int axis = 0; axis < 3; axis++)
        local[axis] = pose[axis] * apart[0] + pose[4 + axis] * apart[1] + pose[8 + axis] * apart[2];
}

/* Positions x (3, rows, columns) in the frames X (columns, 7, 4, 4) at each instant (7, rows, columns, 3). */
static void in_frames(count rows, count columns, in x, in X, double *local) {
    for (int frame = 0; frame < 7; frame++)
        for (count i = 0; i < rows * columns; i++, local += 3)
            in_frame(X + 16 * (7 * (i % columns) + frame), x + i, rows * columns, local);
}

/* Of k patches with corners (3, 4, k), each at a distance from the axis of a capsule with ends (k, 2, 3) in its frame:
   a lower bound, but for the bend, and the distances of the corners (5, k). The first and third corner are at the first
   of two instants, the others at the second: `at` (2, k) among the poses X (n, 7, 4, 4). */
void patch_distances(count k, in X, const count *at, const count *frames, in ends, in corners, double *out) {
    for (count m = 0; m < k; m++) {
        double local[4][3], near[3], apart[3];
        in each[4] = {local[0], local[1], local[2], local[3]}, segment = ends + 6 * m;
        for (int i = 0; i < 4; i++) {
            in_frame(X + 16 * (7 * at[i % 2 * k + m] + frames[m]), corners + i * k + m, 4 * k, local[i]);
            out[(1 + i) * k + m] = nearest_on(segment, local[i], near, apart);
        }
        out[m] = apart_from(segment, 4, each);
    }
}

/* Lower bounds (c, m, n) on the distance of patches of flights from c capsules with ends (c, 2, 3) in frames (c,), but
   for the bend of the flights: on a grid x (3, rows, n + 1) with poses X (n + 1, 7, 4, 4); rates (2, 7, n) that move
   the frames, how far the joints before them reach (7,), bounds on speed and bend (2, m, n), lengths h (n,); scratch
   (7, rows, n + 1, 3). */
void capsule_bounds(count rows, count n, in x, in X, count c, const count *frames, in ends, in rates, in reach,
                    in moving, in h, double *scratch, double *out) {
    const struct grid on = {rows, n + 1, rows > 1 ? rows - 1 : 1, scratch};
    count size = on.patch_rows * n;
    in_frames(rows, n + 1, x, X, scratch);
    for (count row = 0; row < on.patch_rows; row++)
        for (count column = 0; column < n; column++, moving++, out++) {
            double far = 0.0, share = h[column] * h[column] / 8.0;
            in corners[4];
            int number = corners_of(&on, 0, row, column, corners);
            for (int i = 0; i < number; i++) {
                double distance = sqrt(dot(corners[i], corners[i]));
                if (distance > far || distance != distance) far = distance;
            }
            for (count i = 0; i < c; i++) {
                int frame = frames[i];
                double w = rates[frame * n + column], a = rates[(7 + frame) * n + column];
                double turned = (2.0 * w * moving[0] + (a + w * w) * (far + moving[size] + reach[frame])) * share;
                corners_of(&on, frame, row, column, corners);
                out[i * size] = apart_from(ends + 6 * i, number, corners) - turned;
            }
        }
}
