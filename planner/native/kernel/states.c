/* Joint states at the release: Jacobians, inverse kinematics, and which states are kept. */

#include "vectors.h"

static const double PI = 3.14159265358979323846;

static double larger(double a, double b) { return a > b || a != a ? a : b; } /* NaN where either is one */

/* Jacobians (n, 6, 6) of a point p_F of the flange: linear, then angular rows. */
void jacobians(count n, in X, in p_F, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, out += 36) {
        double point[3];
        in_world(X + 6 * 16, p_F, 1.0, point);
        for (int i = 0; i < 6; i++) {
            double axis[3], arm[3], moved[3] = {0.0};
            for (int row = 0; row < 3; row++) {
                axis[row] = X[16 * i + 4 * row + 2];
                arm[row] = point[row] - X[16 * i + 4 * row + 3];
            }
            add_cross(axis, arm, moved);
            for (int row = 0; row < 3; row++) {
                out[6 * row + i] = moved[row];
                out[6 * (3 + row) + i] = axis[row];
            }
        }
    }
}

/* Rows (most,) of the first postures q (n, 6) that differ in some joint by more than `least`; -1 after the last. */
void distinct_rows(count n, in q, double least, count most, count *rows) {
    count kept = 0;
    for (count m = 0; m < n && kept < most; m++) {
        int apart = 1;
        for (count i = 0; i < kept && apart; i++) {
            in one = q + 6 * m, other = q + 6 * rows[i];
            apart = 0;
            for (int joint = 0; joint < 6; joint++) apart |= fabs(one[joint] - other[joint]) > least;
        }
        if (apart) rows[kept++] = m;
    }
    while (kept < most) rows[kept++] = -1;
}

/* An arm's lengths, and what counts as rounding, see `inverse_kinematics`. */
struct arm {
    double base, side, wrist, tool, upper, fore; /* d1, d4, d5, d6, a2, a3 */
    double reach, free; /* REACH_TOLERANCE_M, WRIST_FREE */
};

static double beyond_tolerance(double excess, const struct arm *arm) { return excess > arm->reach ? excess : 0.0; }

/* The direction of the wrist at (x, y) in the arm's plane with the elbow closest to a right angle. */
static void elbow_at_right_angle(double x, double y, const struct arm *arm, double *down) {
    double reach = larger(hypot(x, y), arm->reach), wanted = arm->upper * arm->upper + arm->fore * arm->fore;
    double cosine = (reach * reach + arm->wrist * arm->wrist - wanted) / (2.0 * reach * arm->wrist);
    double angle = atan2(y, x) + acos(clamped(cosine, -1.0, 1.0));
    down[0] = cos(angle);
    down[1] = sin(angle);
}

/* Sets joints 2 and 3 with wrist 1 at (x, y) in the arm's plane; returns the missing reach. */
static double elbow(double x, double y, double sign, const struct arm *arm, double *q) {
    double reach = hypot(x, y), longest = fabs(arm->upper + arm->fore), shortest = fabs(arm->upper - arm->fore);
    double room = larger(longest - reach, 0.0) * (longest + reach);
    double slack = larger(reach - shortest, 0.0) * (reach + shortest);
    q[2] = sign * 2.0 * atan2(sqrt(room), sqrt(slack));
    q[1] = atan2(y, x) - atan2(arm->fore * sin(q[2]), arm->upper + arm->fore * cos(q[2]));
    return beyond_tolerance(larger(reach - longest, shortest - reach), arm);
}

/* The two branches (2, 7) of a shoulder and a wrist, of which joints 1 and 5 are given. */
static void elbows(in frame[3], in p5, in along, in last, double missing, const struct arm *arm, in given, double *out) {
    double c6 = last[0], s6 = last[1], z4[3], x = dot(p5, along), y = p5[2] - arm->base, down[2], q6 = atan2(s6, c6);
    for (int row = 0; row < 3; row++) z4[row] = -(s6 * frame[0][row] + c6 * frame[1][row]);
    down[0] = dot(z4, along);
    down[1] = z4[2];
    if (last[2] < arm->free) {
        elbow_at_right_angle(x, y, arm, down);
        for (int row = 0; row < 3; row++) z4[row] = down[0] * along[row] + (row == 2 ? down[1] : 0.0);
        q6 = atan2(-dot(z4, frame[0]), -dot(z4, frame[1]));
    }
    for (int side = 0; side < 2; side++, out += 7) {
        double q[6] = {given[0], 0.0, 0.0, 0.0, given[1], q6};
        double beyond = elbow(x - arm->wrist * down[0], y - arm->wrist * down[1], side ? -1.0 : 1.0, arm, q);
        q[3] = atan2(down[0], -down[1]) - q[1] - q[2];
        out[6] = larger(missing, beyond);
        for (int i = 0; i < 6; i++) out[i] = q[i] - 2.0 * PI * ceil(q[i] / (2.0 * PI) - 0.5);
    }
}

/* The eight branches of joint positions, and the missing reach (n, 8, 7), of flange poses X (n, 4, 4); `lengths` are
   the numbers of `struct arm`. A branch out of reach is the closest to it. */
void branches(count n, in X, in lengths, double *out) {
    struct arm arm;
    memcpy(&arm, lengths, sizeof arm);
    for (count m = 0; m < n; m++, X += 16) {
        double columns[3][3], p5[3];
        in frame[3] = {columns[0], columns[1], columns[2]};
        for (int row = 0; row < 3; row++) {
            for (int k = 0; k < 3; k++) columns[k][row] = X[4 * row + k];
            p5[row] = X[4 * row + 3] - arm.tool * columns[2][row];
        }
        double radius = hypot(p5[0], p5[1]), ahead = sqrt(larger((radius - arm.side) * (radius + arm.side), 0.0));
        double missing = beyond_tolerance(arm.side - radius, &arm);
        for (int shoulder = 1; shoulder > -2; shoulder -= 2) {
            double q1 = atan2(p5[1], p5[0]) + atan2(arm.side, shoulder * ahead);
            double along[3] = {cos(q1), sin(q1), 0.0}, across[3] = {along[1], -along[0], 0.0};
            double x = dot(across, columns[0]), y = dot(across, columns[1]), z = dot(across, columns[2]);
            double sine = hypot(x, y);
            for (int wrist = 1; wrist > -2; wrist -= 2, out += 14) {
                double scale = wrist / (sine < arm.free ? 1.0 : sine), last[3] = {x * scale, -y * scale, sine};
                double given[2] = {q1, atan2(wrist * sine, z)};
                elbows(frame, p5, along, last, missing, &arm, given, out);
            }
        }
    }
}
