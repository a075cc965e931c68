/* Poses, torques and distances of an arm at many instants.

   n counts instants. A NaN that goes in comes out, so that what cannot be evaluated fails its check. */

#include "vectors.h"

#define STEPS_TO_ZERO 120 /* at most two of them halve the bracket */

/* Poses X (7, 4, 4) of base and links, all zero before; cosines and sines (6,) of the joints, see link_poses. */
static void pose_chain(in cosine, in sine, in dh, in base, double *X) {
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

/* Poses X (n, 7, 4, 4) of base and links; cosines and sines (n, 6) of the joints, dh: a, d, cos alpha, sin alpha. */
void link_poses(count n, in cosine, in sine, in dh, in base, double *X) {
    memset(X, 0, n * 7 * 16 * sizeof *X);
    for (count k = 0; k < n; k++) pose_chain(cosine + 6 * k, sine + 6 * k, dh, base, X + 7 * 16 * k);
}

/* Poses (n, 4, 4) of the last link, as of `link_poses`. */
void flange_poses(count n, in cosine, in sine, in dh, in base, double *out) {
    double X[7 * 16] = {0.0};
    for (count k = 0; k < n; k++, out += 16) {
        pose_chain(cosine + 6 * k, sine + 6 * k, dh, base, X);
        memcpy(out, X + 6 * 16, 16 * sizeof *out);
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

/* Adds the velocity of a point of the world that moves with the frame `frame`, at joint velocities qd. */
static void add_velocity(in X, in qd, int frame, in point, double *out) {
    for (int i = 0; i < frame; i++) {
        double turn[3], arm[3];
        for (int row = 0; row < 3; row++) {
            turn[row] = X[16 * i + 4 * row + 2] * qd[i];
            arm[row] = point[row] - X[16 * i + 4 * row + 3];
        }
        add_cross(turn, arm, out);
    }
}

/* Velocities (3, n) of a point (3, n) that moves with the flange. */
void point_velocity(count n, in X, in qd, in point, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6) {
        double place[3] = {point[m], point[n + m], point[2 * n + m]}, v[3] = {0.0};
        add_velocity(X, qd, 6, place, v);
        for (int row = 0; row < 3; row++) out[row * n + m] = v[row];
    }
}

/* Speeds (n,) of the fastest of k points, given in their frames (k, 3). */
void fastest(count n, in X, in qd, count k, const count *frames, in places, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6) {
        out[m] = 0.0;
        for (count i = 0; i < k; i++) {
            double point[3], v[3] = {0.0};
            in_world(X + 16 * frames[i], places + 3 * i, 1.0, point);
            add_velocity(X, qd, frames[i], point, v);
            double speed = sqrt(dot(v, v));
            if (speed > out[m] || speed != speed) out[m] = speed;
        }
    }
}

/* Linear momentum (3, n) of the links, of masses (6,) with centres at coms (6, 3) in their frames. */
void momentum(count n, in X, in qd, in mass, in coms, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6) {
        double p[3] = {0.0};
        for (int i = 0; i < 6; i++) {
            double com[3], v[3] = {0.0};
            in_world(X + 16 * (i + 1), coms + 3 * i, 1.0, com);
            add_velocity(X, qd, i + 1, com, v);
            for (int row = 0; row < 3; row++) p[row] += mass[i] * v[row];
        }
        for (int row = 0; row < 3; row++) out[row * n + m] = p[row];
    }
}

/* Adds the acceleration of a point r beyond the origin of its link: alpha x r + omega x (omega x r). */
static void add_relative(in omega, in alpha, in r, double *out) {
    double v[3] = {0.0};
    add_cross(omega, r, v);
    add_cross(alpha, r, out);
    add_cross(omega, v, out);
}

/* The arm at one instant, in a posture. */
struct chain {
    double axis[6][3], origin[7][3]; /* of the joints; of the frames */
    double omega[3], alpha[3], acceleration[3]; /* of the link reached so far, and of its frame's origin */
};

static struct chain chain_at(in X) {
    struct chain at;
    for (int i = 0; i < 7; i++)
        for (int row = 0; row < 3; row++) {
            at.origin[i][row] = X[16 * i + 4 * row + 3];
            if (i < 6) at.axis[i][row] = X[16 * i + 4 * row + 2];
        }
    return at;
}

/* Begins a motion at the base, which has the acceleration `upward`. */
static void begin(in upward, struct chain *at) {
    memset(at->omega, 0, sizeof at->omega);
    memset(at->alpha, 0, sizeof at->alpha);
    memcpy(at->acceleration, upward, sizeof at->acceleration);
}

/* Goes on to link i, from the base outwards. */
static void outwards(int i, double qd, double qdd, struct chain *at) {
    double turn[3], offset[3];
    for (int row = 0; row < 3; row++) {
        turn[row] = at->axis[i][row] * qd;
        at->omega[row] += turn[row];
        at->alpha[row] += at->axis[i][row] * qdd;
        offset[row] = at->origin[i + 1][row] - at->origin[i][row];
    }
    add_cross(at->omega, turn, at->alpha);
    add_relative(at->omega, at->alpha, offset, at->acceleration);
}

/* Accelerations (3, n) of a point (3, n) that moves with the flange. */
void point_acceleration(count n, in X, in qd, in qdd, in point, double *out) {
    const double still[3] = {0.0};
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6, qdd += 6) {
        struct chain at = chain_at(X);
        double tip[3];
        begin(still, &at);
        for (int i = 0; i < 6; i++) outwards(i, qd[i], qdd[i], &at);
        for (int row = 0; row < 3; row++) tip[row] = point[row * n + m] - at.origin[6][row];
        add_relative(at.omega, at.alpha, tip, at.acceleration);
        for (int row = 0; row < 3; row++) out[row * n + m] = at.acceleration[row];
    }
}

/* The links' masses and inertias, in a posture: centres of mass from the frames' origins, principal axes; a point mass
   from the flange's origin. */
struct bodies {
    in mass, principal;
    double com[6][3], axis[6][3][3], tip[3];
};

/* Returns them for masses (6,), centres of mass and principal axes fixed (4, 6, 3), and inertias about these (3, 6). */
static struct bodies bodies_at(in X, in mass, in fixed, in principal, in p_F) {
    struct bodies of = {.mass = mass, .principal = principal};
    for (int i = 0; i < 6; i++) {
        in frame = X + 16 * (i + 1);
        in_world(frame, fixed + 3 * i, 0.0, of.com[i]);
        for (int k = 0; k < 3; k++) in_world(frame, fixed + 18 * (k + 1) + 3 * i, 0.0, of.axis[i][k]);
    }
    in_world(X + 16 * 6, p_F, 0.0, of.tip);
    return of;
}

/* Adds the moment of link i about its centre of mass: I alpha + omega x I omega. */
static void add_turning(const struct bodies *of, int i, const struct chain *at, double *moment) {
    double inertia_omega[3] = {0.0};
    for (int k = 0; k < 3; k++) {
        in axis = of->axis[i][k];
        double inertia = of->principal[6 * k + i];
        double spin = inertia * dot(axis, at->omega), gain = inertia * dot(axis, at->alpha);
        for (int row = 0; row < 3; row++) {
            inertia_omega[row] += axis[row] * spin;
            moment[row] += axis[row] * gain;
        }
    }
    add_cross(at->omega, inertia_omega, moment);
}

/* Finds force and moment about the world's origin that move link i, which has been reached. */
static void load(const struct bodies *of, int i, const struct chain *at, double *force, double *moment) {
    double place[3];
    memcpy(force, at->acceleration, 3 * sizeof *force);
    add_relative(at->omega, at->alpha, of->com[i], force);
    for (int row = 0; row < 3; row++) {
        force[row] *= of->mass[i];
        place[row] = at->origin[i + 1][row] + of->com[i][row];
        moment[row] = 0.0;
    }
    add_turning(of, i, at, moment);
    add_cross(place, force, moment);
}

/* The torque of joint i that a force at a point needs. */
static double of_force(int i, in point, in force, const struct chain *at) {
    double arm[3], moment[3] = {0.0};
    for (int row = 0; row < 3; row++) arm[row] = point[row] - at->origin[i][row];
    add_cross(arm, force, moment);
    return dot(at->axis[i], moment);
}

/* Torques of a motion (6,), and then per kilogram of the point mass (6,), by Newton and Euler; `stride` apart. */
static void torques(const struct bodies *of, in qd, in qdd, in upward, struct chain *at, count stride, double *out) {
    double force[6][3], moment[6][3], point[3];
    begin(upward, at);
    for (int i = 0; i < 6; i++) {
        outwards(i, qd[i], qdd[i], at);
        load(of, i, at, force[i], moment[i]);
    }
    add_relative(at->omega, at->alpha, of->tip, at->acceleration);
    for (int row = 0; row < 3; row++) point[row] = at->origin[6][row] + of->tip[row];
    for (int i = 5; i >= 0; i--) {
        double about[3] = {0.0}, turning[3];
        for (int row = 0; row < 3 && i < 5; row++) {
            force[i][row] += force[i + 1][row];
            moment[i][row] += moment[i + 1][row];
        }
        add_cross(at->origin[i], force[i], about);
        for (int row = 0; row < 3; row++) turning[row] = moment[i][row] - about[row];
        out[i * stride] = dot(at->axis[i], turning);
        out[(6 + i) * stride] = of_force(i, point, at->acceleration, at);
    }
}

/* Torques (6, n) of bodies, and per kilogram of a point mass at p_F on the flange (6, n). */
void chain_torques(count n, in X, in qd, in qdd, in mass, in fixed, in principal, in upward, in p_F, double *out) {
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6, qdd += 6) {
        struct bodies of = bodies_at(X, mass, fixed, principal, p_F);
        struct chain at = chain_at(X);
        torques(&of, qd, qdd, upward, &at, n, out + m);
    }
}

/* Torques as of `chain_torques` (3, 2, 6, n): of the motion, without accelerations, and M qd. */
void torque_terms(count n, in X, in qd, in qdd, in mass, in fixed, in principal, in upward, in p_F, double *out) {
    const double none[6] = {0.0};
    for (count m = 0; m < n; m++, X += 7 * 16, qd += 6, qdd += 6) {
        struct bodies of = bodies_at(X, mass, fixed, principal, p_F);
        struct chain at = chain_at(X);
        torques(&of, qd, qdd, upward, &at, n, out + m);
        torques(&of, qd, none, upward, &at, n, out + m + 12 * n);
        torques(&of, none, qd, none, &at, n, out + m + 24 * n);
    }
}

/* The distance of two segments along u and v, whose first ends are w apart. Source: see segment_segment_distance. */
double segment_distance(in u, in v, in w, double shortest) {
    double gap[3], uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
    double determinant = uu * vv - uv * uv;
    double s = determinant > DBL_EPSILON * uu * vv ? (vv * uw - uv * vw) / determinant : 0.0;
    double t = clamped((clamped(s, 0.0, 1.0) * uv - vw) / (vv > shortest ? vv : shortest), 0.0, 1.0);
    s = clamped((uw + t * uv) / (uu > shortest ? uu : shortest), 0.0, 1.0);
    for (int row = 0; row < 3; row++) gap[row] = w[row] + t * v[row] - s * u[row];
    return sqrt(dot(gap, gap));
}

/* Distances (p, n) of p pairs (p, 2) of segments with ends (k, 2, 3, n). */
void pair_distances(count n, in ends, count p, const count *pairs, double shortest, double *out) {
    for (count i = 0; i < p; i++)
        for (count m = 0; m < n; m++) {
            in one = ends + 6 * n * pairs[2 * i] + m, other = ends + 6 * n * pairs[2 * i + 1] + m;
            double u[3], v[3], w[3];
            for (int row = 0; row < 3; row++, one += n, other += n) {
                u[row] = one[3 * n] - one[0];
                v[row] = other[3 * n] - other[0];
                w[row] = other[0] - one[0];
            }
            out[i * n + m] = segment_distance(u, v, w, shortest);
        }
}

/* The vector from the closest point of a box to the point at a share of the segment from p0 along `along`. */
static void outside(in p0, in along, double share, in lower, in upper, double *gap) {
    for (int row = 0; row < 3; row++) {
        double p = p0[row] + share * along[row];
        gap[row] = p - clamped(p, lower[row], upper[row]);
    }
}

/* The distance of a segment p0-p1 from a box. See segment_shape_distance. */
static double box_distance(in p0, in p1, in lower, in upper) {
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
    return sqrt(dot(gap, gap));
}

/* Half the square of a point's distance from the cylinder about z in a box has this slope along a segment, at a share
   of it. Also how fast the slope rises, and the vector from the closest point of the cylinder. */
static double cylinder_slope(in p0, in along, double share, in lower, in upper, double *rise, double *gap) {
    double radius = upper[0];
    outside(p0, along, share, lower, upper, gap);
    *rise = gap[2] != 0.0 ? along[2] * along[2] : 0.0;
    double x = p0[0] + share * along[0], y = p0[1] + share * along[1], from_axis = sqrt(x * x + y * y);
    double beyond = from_axis > radius ? 1.0 - radius / from_axis : 0.0 * from_axis;
    double across = x * along[0] + y * along[1];
    gap[0] = beyond * x;
    gap[1] = beyond * y;
    if (from_axis > radius) {
        *rise += beyond * (along[0] * along[0] + along[1] * along[1]);
        *rise += radius * across * across / (from_axis * from_axis * from_axis);
    }
    return dot(gap, along);
}

/* The distance of a segment p0-p1 from the cylinder about z in a box. The slope never falls along the segment: its zero
   is found by Newton's steps, halving wherever one leaves the bracket or is not half as long as the one before. */
static double cylinder_distance(in p0, in p1, in lower, in upper) {
    double along[3], gap[3], rise, low = 0.0, high = 1.0, share = 0.0, step = 1.0;
    for (int row = 0; row < 3; row++) along[row] = p1[row] - p0[row];
    if (cylinder_slope(p0, along, 0.0, lower, upper, &rise, gap) >= 0.0) return sqrt(dot(gap, gap));
    if (cylinder_slope(p0, along, 1.0, lower, upper, &rise, gap) <= 0.0) return sqrt(dot(gap, gap));
    for (int i = 0; i < STEPS_TO_ZERO && fabs(step) > DBL_EPSILON * share; i++) {
        double slope = cylinder_slope(p0, along, share, lower, upper, &rise, gap);
        if (slope == 0.0) break;
        if (slope < 0.0)
            low = share;
        else
            high = share;
        double next = share - slope / rise;
        if (!(next > low && next < high && fabs(next - share) < 0.5 * fabs(step))) next = 0.5 * (low + high);
        step = next - share;
        share = next;
    }
    cylinder_slope(p0, along, share, lower, upper, &rise, gap);
    return sqrt(dot(gap, gap));
}

/* A point of the world in a shape's frame. */
void in_shape(in shape, in p, double *out) {
    double apart[3];
    for (int row = 0; row < 3; row++) apart[row] = p[row] - shape[9 + row];
    for (int row = 0; row < 3; row++)
        out[row] = shape[row] * apart[0] + shape[3 + row] * apart[1] + shape[6 + row] * apart[2];
}

/* The distance of a segment p0-p1 from a shape (20,), see Solid.row. */
double shape_distance(in shape, in p0, in p1) {
    double start[3], end[3];
    in_shape(shape, p0, start);
    in_shape(shape, p1, end);
    return (shape[18] > 0.0 ? cylinder_distance : box_distance)(start, end, shape + 12, shape + 15) - shape[19];
}

/* Distances (k, n) of segments p0-p1, each (n, 3), from every shape of the rows (k, 20). */
void all_shape_distances(count n, in p0, in p1, count k, in rows, double *out) {
    for (count j = 0; j < k; j++)
        for (count m = 0; m < n; m++) out[j * n + m] = shape_distance(rows + 20 * j, p0 + 3 * m, p1 + 3 * m);
}

/* Distances (n,) of segments p0-p1, each (n, 3), from shapes: `items` (n,) of the rows (k, 20). */
void shape_distances(count n, in p0, in p1, const count *items, in rows, double *out) {
    for (count m = 0; m < n; m++) out[m] = shape_distance(rows + 20 * items[m], p0 + 3 * m, p1 + 3 * m);
}
