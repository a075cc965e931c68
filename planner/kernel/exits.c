/* The ways on which the object leaves the tool. See planner/certificate/exits.py. */

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
   (7, k): angles from the axis (3,) at the corners and where the object gets out, room, whether it is out. */
void exit_cells(count p, in w, in s, count k, const count *corners, in deviation, in axis, double half, double out_m,
                double *out) {
    const double tiny = 1e-9;
    for (count m = 0; m < k; m++) {
        double v[4][3], size[4], angle[4], root[4], leaving = -INFINITY, room = INFINITY, mean[3];
        for (int i = 0; i < 4; i++) {
            count at = corners[i * k + m];
            for (int row = 0; row < 3; row++) v[i][row] = w[row * p + at];
            size[i] = sqrt(dot(v[i], v[i]));
            double moved = 0.5 * size[i] * s[at] * s[at];
            root[i] = sqrt(moved);
            angle[i] = angle_from(axis, v[i]);
            out[i * k + m] = moved >= out_m ? -INFINITY : angle[i];
            double deep = size[i] * sin(at_least(half - angle[i], -0.5 * M_PI));
            if (deep < room || deep != deep) room = deep;
        }
        for (int i = 0; i < 4; i += 2) {
            if (!(out[(i + 1) * k + m] == -INFINITY) || out[i * k + m] == -INFINITY) continue;
            double share = (sqrt(out_m) - root[i]) / at_least(root[i + 1] - root[i], tiny), there[3];
            for (int row = 0; row < 3; row++) there[row] = v[i][row] + share * (v[i + 1][row] - v[i][row]);
            leaving = at_least(angle_from(axis, there), leaving);
        }
        for (int row = 0; row < 3; row++) mean[row] = v[0][row] + v[2][row];
        double first = dot(v[0], mean), last = dot(v[2], mean), begin = s[corners[m]];
        double least = (first < last ? first : last) / at_least(sqrt(dot(mean, mean)), tiny);
        out[4 * k + m] = leaving;
        out[5 * k + m] = (half > 0.5 * M_PI ? outside_of(axis, half, v) : room) - deviation[m];
        out[6 * k + m] = 0.5 * (least - deviation[m]) * (begin * begin) >= out_m;
    }
}
