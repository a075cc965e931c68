/* Lower bounds on the object's distance from the capsules of the arm. See planner/certificate/flight/patches.py. */

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

/* The least n . (corner - near) over the corners, with n the direction from the nearest point of a segment (2, 3) to
   their mean. See segment_bound. */
static double apart_from(in segment, int number, in *corners) {
    const double tiny = 1e-12;
    double mean[3] = {0.0}, along[3], off[3], near[3], apart[3], least = INFINITY;
    for (int row = 0; row < 3; row++) {
        for (int i = 0; i < number; i++) mean[row] += corners[i][row];
        mean[row] /= number;
        along[row] = segment[3 + row] - segment[row];
        off[row] = mean[row] - segment[row];
    }
    double square = dot(along, along), share = dot(off, along) / (square < tiny * tiny ? tiny * tiny : square);
    share = clamped(share, 0.0, 1.0);
    for (int row = 0; row < 3; row++) {
        near[row] = segment[row] + share * along[row];
        apart[row] = mean[row] - near[row];
    }
    double length = sqrt(dot(apart, apart));
    for (int i = 0; i < number; i++) {
        double reach = dot(apart, corners[i]);
        if (reach < least || reach != reach) least = reach;
    }
    return (least - dot(apart, near)) / (length < tiny ? tiny : length);
}

/* Positions x (3, rows, columns) in the frames X (columns, 7, 4, 4) at each instant (7, rows, columns, 3). */
static void in_frames(count rows, count columns, in x, in X, double *local) {
    for (int frame = 0; frame < 7; frame++)
        for (count i = 0; i < rows * columns; i++, local += 3) {
            in pose = X + 16 * (7 * (i % columns) + frame);
            double apart[3];
            for (int row = 0; row < 3; row++) apart[row] = x[row * rows * columns + i] - pose[4 * row + 3];
            for (int axis = 0; axis < 3; axis++)
                local[axis] = pose[axis] * apart[0] + pose[4 + axis] * apart[1] + pose[8 + axis] * apart[2];
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
