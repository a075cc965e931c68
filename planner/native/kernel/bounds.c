/* Motions between their samples: states, extremes inside ticks, and bounds over intervals.

   See planner/trajectory.py, and bounds.py, joints.py and loads.py of planner/certificate. */

#include "vectors.h"

/* States q, qd, qdd (3, k, c) at times t (k,) of a motion with n samples (n, c) of each, and jerks (n - 1, c). */
void states_at(count k, in t, count n, count c, double rate, in q, in qd, in qdd, in jerk, double *out) {
    for (count m = 0; m < k; m++) {
        double time = clamped(t[m], 0.0, (n - 1) / rate);
        count i = time > 0.0 ? (count)(time * rate) : 0;
        if (i > n - 2) i = n - 2;
        double s = time - i / rate;
        for (count j = i * c; j < (i + 1) * c; j++, out++) {
            out[0] = q[j] + s * (qd[j] + s * (qdd[j] / 2.0 + s * jerk[j] / 6.0));
            out[k * c] = qd[j] + s * (qdd[j] + s * jerk[j] / 2.0);
            out[2 * k * c] = qdd[j] + s * jerk[j];
        }
    }
}

/* The largest size in the first of c columns over the rows from first to last; a NaN, where there is one. */
static double largest(in values, count c, count first, count last) {
    double most = 0.0, spoilt = 0.0;
    for (count k = c * first; k <= c * last; k += c) {
        double size = fabs(values[k]);
        most = size > most ? size : most;
        spoilt += 0.0 * size;
    }
    return most + spoilt;
}

/* Bounds (4, c, k - 1) on |qd|, |qdd|, |jerk| of c joints from each of k rows to the next, and sums of the jumps of the
   jerk between these; for qd, qdd (n, c) and the jerk of every tick (n - 1, c). */
void joint_rates(count c, in qd, in qdd, in jerk, double dt, count k, const count *rows, double *out) {
    count m = k - 1, size = c * m;
    for (count i = 0; i < m; i++) {
        count first = rows[i], last = rows[i + 1];
        for (count j = 0; j < c; j++) {
            double *to = out + j * m + i, jumps = 0.0;
            to[0] = largest(qd + j, c, first, last);
            to[size] = largest(qdd + j, c, first, last);
            to[2 * size] = largest(jerk + j, c, first, last - 1);
            to[0] += to[2 * size] * (dt * dt) / 8.0;
            for (count at = c * (first + 1) + j; at < c * last; at += c) jumps += fabs(jerk[at] - jerk[at - c]);
            to[3 * size] = jumps;
        }
    }
}

/* For bounds (3, c, m) on |qd|, |qdd|, |jerk| (11, c, m): their sums over the joints up to each; bounds on the first to
   fourth derivative of a direction beyond it; what the joint adds to these. */
void derivative_bounds(count c, count m, in rates, double *out) {
    count size = c * m;
    for (count i = 0; i < m; i++) {
        double s = 0.0, a = 0.0, j = 0.0, before[4] = {0.0};
        for (count place = i; place < size; place += m) {
            double *to = out + place;
            s += rates[place];
            a += rates[place + size];
            j += rates[place + 2 * size];
            double s2 = s * s, cubic = j + 3.0 * s * a + s2 * s;
            double total[4] = {s, a + s2, cubic, 4.0 * s * j + 3.0 * a * a + 6.0 * s2 * a + s2 * s2};
            to[0] = s;
            to[size] = a;
            to[2 * size] = j;
            for (int order = 0; order < 4; order++) {
                to[(3 + order) * size] = total[order];
                to[(7 + order) * size] = total[order] - before[order];
                before[order] = total[order];
            }
        }
    }
}

/* What a cell's joints move: levers and moment arms (8, 6) and masses (8,) of the bodies, moments of inertia that each
   joint turns (6,), bounds on torque per acceleration (6, 6). */
struct loads {
    in lever, moment_arm, mass, turned, mass_matrix;
    double inertia, gravity;
};

/* Adds what a body adds to the bounds (33,) on one interval; d bounds the derivatives of its centre of mass. */
static void add_body(const struct loads *of, int body, in d, double w1, double bend, double *sum) {
    double force = d[3] + 4.0 * w1 * d[2] + bend * (d[1] + of->gravity);
    double turn = d[1] + 2.0 * w1 * d[0], turning = d[2] + 4.0 * w1 * d[1] + bend * d[0];
    for (int j = 0; j < 6; j++) {
        double arm = of->moment_arm[6 * body + j];
        sum[j] += arm * force;
        sum[12 + j] += arm * d[0];
        sum[18 + j] += arm * turn;
        sum[24 + j] += arm * turning;
    }
    sum[30] += of->mass[body] * d[2];
    sum[31] += of->mass[body] * (d[2] * (3.0 * d[1] + of->gravity) + d[0] * d[3]);
}

/* Adds what the turning of the links adds; w bounds the derivatives of a direction. */
static void add_turns(const struct loads *of, in w, double bend, in qd, in jumps, double *sum) {
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < 6; k++) sum[6 + j] += of->mass_matrix[6 * j + k] * jumps[k];
        sum[j] += of->turned[j] * 2.0 * (w[3] + 4.0 * w[0] * w[2] + bend * w[1]);
        sum[12 + j] += of->turned[j] * w[0];
        sum[18 + j] += of->turned[j] * (w[1] + w[0] * w[0]);
        sum[24 + j] += of->turned[j] * (w[2] + 3.0 * w[0] * w[1]);
        sum[32] += qd[j] * sum[6 + j];
    }
    sum[31] += of->inertia * (3.0 * w[1] * w[2] + w[0] * w[3]);
}

/* Bounds (33, m) on m intervals, for rates (4, 6, m) of `joint_rates` and their `derivative_bounds` (11, 6, m): on the
   second derivatives of the torques (6) and the jumps of their slope (6), on the angular momenta about the joints and
   two derivatives (18), on the second derivatives of momentum (1) and power (1), on the jumps of the latter's slope. */
void load_bounds(count m, in rates, in bounds, in lever, in moment_arm, in mass, in turned, in mass_matrix,
                 double inertia, double gravity, double *out) {
    const struct loads of = {lever, moment_arm, mass, turned, mass_matrix, inertia, gravity};
    for (count i = 0; i < m; i++) {
        double sum[33] = {0.0}, weight[6][4], w[4], qd[6], jumps[6];
        for (int j = 0; j < 6; j++) {
            for (int order = 0; order < 4; order++) weight[j][order] = bounds[((7 + order) * 6 + j) * m + i];
            qd[j] = rates[j * m + i];
            jumps[j] = rates[(18 + j) * m + i];
        }
        for (int order = 0; order < 4; order++) w[order] = bounds[((3 + order) * 6 + 5) * m + i];
        double bend = 2.0 * (w[1] + w[0] * w[0]);
        for (int body = 0; body < 8; body++) {
            double d[4] = {0.0};
            for (int j = 0; j < 6; j++)
                for (int order = 0; order < 4; order++) d[order] += lever[6 * body + j] * weight[j][order];
            add_body(&of, body, d, w[0], bend, sum);
        }
        add_turns(&of, w, bend, qd, jumps, sum);
        for (int row = 0; row < 33; row++) out[row * m + i] = sum[row];
    }
}

/* The higher of two numbers, not finite where one is not. Without a branch, so that several are found at once. */
static double higher_of(double a, double b) { return (a > b ? a : b) + 0.0 * (a + b); }

/* Keeps the larger of values (6,) and largest ones so far, and ticks (6,); what is not finite is infinite. */
static void keep(in values, count tick, double *most, double *at) {
    int all_lower = 1;
    for (int j = 0; j < 6; j++) all_lower &= values[j] <= most[j];
    for (int j = 0; j < 6 && !all_lower; j++) {
        double value = isfinite(values[j]) ? values[j] : INFINITY;
        if (!(value > most[j])) continue;
        most[j] = value;
        at[j] = tick;
    }
}

/* Raises -q and q to where a joint turns back inside a tick of dt that begins with q, v, a and has a jerk. */
static void turn_back(double dt, double q, double v, double a, double jerk, double *below, double *above) {
    double root = sqrt(a * a - 2.0 * jerk * v), s[3] = {(-a + root) / jerk, (-a - root) / jerk, -v / a};
    for (int i = 0; i < 3; i++) {
        double t = isfinite(s[i]) ? clamped(s[i], 0.0, dt) : 0.0;
        double turn = q + t * (v + t * (a / 2.0 + t * jerk / 6.0));
        *below = higher_of(*below, -turn);
        *above = higher_of(*above, turn);
    }
}

/* The largest values (6, 6), and their ticks (6, 6), of -q, q, |qd|, |qdd|, |jerk| and the disagreement of neighbouring
   samples of each joint; for q, qd, qdd (n, 6) and the jerk of every tick (n - 1, 6). */
void joint_extremes(count n, double dt, in q, in qd, in qdd, in jerk, double *out) {
    double found[6][6];
    for (int k = 0; k < 72; k++) out[k] = k < 36 ? -INFINITY : 0.0;
    for (count i = 0; i + 1 < n; i++, q += 6, qd += 6, qdd += 6, jerk += 6) {
        for (int j = 0; j < 6; j++) {
            double speed = fabs((qd[j + 6] - qd[j]) - dt * (qdd[j] + qdd[j + 6]) / 2.0);
            double place = fabs((q[j + 6] - q[j]) - dt * (qd[j] + dt * (2.0 * qdd[j] + qdd[j + 6]) / 6.0));
            found[0][j] = higher_of(-q[j], -q[j + 6]);
            found[1][j] = higher_of(q[j], q[j + 6]);
            found[2][j] = higher_of(fabs(qd[j]), fabs(qd[j + 6]));
            found[3][j] = fabs(qdd[j]);
            found[4][j] = fabs(jerk[j]);
            found[5][j] = higher_of(speed, place);
        }
        for (int j = 0; j < 6; j++) {
            double swings = qdd[j] * qdd[j + 6];
            if (!(qd[j] * qd[j + 6] > 0.0 && swings >= 0.0))
                turn_back(dt, q[j], qd[j], qdd[j], jerk[j], found[0] + j, found[1] + j);
            if (swings < 0.0) found[2][j] = higher_of(found[2][j], fabs(qd[j] - qdd[j] * qdd[j] / (2.0 * jerk[j])));
        }
        for (int kind = 0; kind < 6; kind++) keep(found[kind], i, out + 6 * kind, out + 36 + 6 * kind);
    }
    for (int j = 0; j < 6; j++) found[3][j] = fabs(qdd[j]);
    keep(found[3], n - 1, out + 18, out + 54);
}
