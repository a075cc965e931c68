/* Paths of an arm among obstacles: whether straight pieces in joint space are clear, and trees of such pieces.

   See planner/approach/rrt_connect.py. */

#include <stdlib.h>

#include "vectors.h"

enum { CAPSULE = 16, PAIR = 9, SHAPE = 21 }; /* numbers of each row */

/* Something whose distance counts: of a capsule from a shape, from the floor, or of the last one from the walls of its
   box or of another room; or of the capsules of a pair from each other. */
struct item {
    enum { FROM_SHAPE, FROM_FLOOR, FROM_WALLS, IN_ROOM, OF_PAIR } kind;
    int one, other;
};

/* What moves among what, and how far a posture keeps away from it; the arguments of `pieces_clear`. */
struct scene {
    in chain; /* poses of the base and of each link beyond its joint (7, 4, 4) */
    count capsules;
    in capsule; /* rows: frame, ends (2, 3) in it, radius, levers (6), whether it may meet the floor, and the shapes */
    count pairs;
    in pair; /* rows: two capsules, least distance of their segments, levers (6) between them */
    count shapes;
    in shape; /* rows: of the shape (20), least distance from it */
    in bounds; /* least height, lower and upper corner of where the first end of the last capsule stays (7,) */
    in touching; /* whether each shape and each capsule may touch (shapes, capsules) */
    count rooms;
    in room; /* rows: of the shapes that it stays in, too (20), least distance from their walls */
    in ends;   /* start and goal (2, 6), about which the margin grows from nothing */
    double margin, own; /* kept from everything else, and between two of the capsules, away from both ends [m] */
    double near, spacing, point; /* by which distance the margins are whole, and of postures [rad]; [m^2] */
    count looked;                /* postures evaluated so far */
    count items;
    struct item *item; /* all that counts; behind it room for what stays open of a piece, its half and so on */
};

/* A capsule of the arm in a posture: ends of its segment in the world, its middle and half its length, and how far its
   points move at most up to the ends of the piece about the posture. */
struct stand {
    double end[2][3], middle[3], reach, moved;
};

static double moved_by(in lever, in half) {
    double sum = 0.0;
    for (int j = 0; j < 6; j++) sum += lever[j] * half[j];
    return sum;
}

static void stand_at(const struct scene *scene, in q, in half, struct stand *at) {
    double cosine[6], sine[6], X[7 * 16];
    for (int j = 0; j < 6; j++) {
        cosine[j] = cos(q[j]);
        sine[j] = sin(q[j]);
    }
    fixed_chain_poses(1, cosine, sine, scene->chain + 16, scene->chain, X);
    for (count i = 0; i < scene->capsules; i++) {
        in row = scene->capsule + CAPSULE * i;
        double along[3];
        for (int end = 0; end < 2; end++) in_world(X + 16 * (int)row[0], row + 1 + 3 * end, 1.0, at[i].end[end]);
        for (int k = 0; k < 3; k++) {
            at[i].middle[k] = 0.5 * (at[i].end[0][k] + at[i].end[1][k]);
            along[k] = at[i].end[1][k] - at[i].middle[k];
        }
        at[i].reach = sqrt(dot(along, along));
        at[i].moved = moved_by(row + 8, half);
    }
}

/* Whether a capsule's segment is farther from a shape than a distance, by its middle and the box about the core. */
static int is_beyond(in shape, const struct stand *at, double distance) {
    double x[3], gap[3], least = distance + at->reach + shape[19];
    in_shape(shape, at->middle, x);
    for (int row = 0; row < 3; row++) gap[row] = x[row] - clamped(x[row], shape[12 + row], shape[15 + row]);
    return dot(gap, gap) > least * least;
}

/* Whether the segments of two capsules are farther apart than a distance, by their middles. */
static int are_beyond(const struct stand *one, const struct stand *other, double distance) {
    double gap[3], least = distance + one->reach + other->reach;
    for (int row = 0; row < 3; row++) gap[row] = one->middle[row] - other->middle[row];
    return dot(gap, gap) > least * least;
}

/* How deep a point is in a shape, negative outside: `Solid.depth`. */
static double depth(in shape, in p) {
    double x[3], gap[3], inside = INFINITY;
    in_shape(shape, p, x);
    for (int row = 0; row < 3; row++) gap[row] = x[row] - clamped(x[row], shape[12 + row], shape[15 + row]);
    if (shape[19] > 0.0) return shape[19] - sqrt(dot(gap, gap));
    for (int row = shape[18] > 0.0 ? 2 : 0; row < 3; row++)
        inside = fmin(inside, fmin(x[row] - shape[12 + row], shape[15 + row] - x[row]));
    return shape[18] > 0.0 ? fmin(inside, shape[15] - sqrt(x[0] * x[0] + x[1] * x[1])) : inside;
}

/* How much farther away than it must be something is in a posture; and how far its distance changes at most up to the
   ends of the piece. Infinite where it is more than that and `enough`. */
static double spare_of(const struct scene *scene, const struct item *item, const struct stand *at, in half,
                       double enough, double *moved) {
    const struct stand *one = at + item->one;
    in row = scene->capsule + CAPSULE * item->one;
    *moved = one->moved;
    if (item->kind == FROM_SHAPE) {
        in shape = scene->shape + SHAPE * item->other;
        double least = row[7] + shape[20];
        if (is_beyond(shape, one, least + enough + *moved)) return INFINITY;
        return shape_distance(shape, one->end[0], one->end[1]) - least;
    }
    if (item->kind == FROM_FLOOR) return fmin(one->end[0][2], one->end[1][2]) - row[7] - scene->bounds[0];
    if (item->kind == FROM_WALLS) {
        double spare = INFINITY;
        for (int k = 0; k < 3; k++) {
            double inside = fmin(one->middle[k] - scene->bounds[1 + k], scene->bounds[4 + k] - one->middle[k]);
            spare = fmin(spare, inside);
        }
        return spare;
    }
    if (item->kind == IN_ROOM) {
        in room = scene->room + SHAPE * item->other;
        return depth(room, one->middle) - room[20];
    }
    in pair = scene->pair + PAIR * item->other;
    const struct stand *other = at + (int)pair[1];
    double u[3], v[3], w[3];
    *moved = moved_by(pair + 3, half);
    if (are_beyond(one, other, pair[2] + enough + *moved)) return INFINITY;
    for (int k = 0; k < 3; k++) {
        u[k] = one->end[1][k] - one->end[0][k];
        v[k] = other->end[1][k] - other->end[0][k];
        w[k] = other->end[0][k] - one->end[0][k];
    }
    return segment_distance(u, v, w, scene->point) - pair[2];
}

/* The share of the margin that a posture keeps: all of it away from both ends. */
static double share_at(const struct scene *scene, in q) {
    double share = 1.0;
    for (int end = 0; end < 2; end++) {
        double away = 0.0;
        for (int j = 0; j < 6; j++) away = fmax(away, fabs(q[j] - scene->ends[6 * end + j]));
        share = fmin(share, away / scene->near);
    }
    return share;
}

/* Whether a straight piece is clear of `items`: in its middle, and in either half of what may be too close there. What
   the levers prove clear of the whole piece is not looked at again. */
static int is_clear(struct scene *scene, in from, in to, count n, struct item *items) {
    double q[6], half[6], longest = 0.0;
    struct stand at[scene->capsules];
    struct item *open = items + n;
    count left = 0;
    for (int j = 0; j < 6; j++) {
        q[j] = 0.5 * (from[j] + to[j]);
        half[j] = 0.5 * fabs(to[j] - from[j]);
        longest = fmax(longest, half[j]);
    }
    stand_at(scene, q, half, at);
    scene->looked++;
    double share = share_at(scene, q);
    for (count i = 0; i < n; i++) {
        double margin = items[i].kind == OF_PAIR ? scene->own : scene->margin;
        double moved, spare = spare_of(scene, items + i, at, half, margin, &moved);
        if (!(spare >= margin * share)) return 0;
        if (spare < margin + moved) open[left++] = items[i];
    }
    if (left == 0 || 2.0 * longest <= scene->spacing) return 1;
    return is_clear(scene, from, q, left, open) && is_clear(scene, q, to, left, open);
}

/* Lists all that counts in a scene, with room for pieces as long as `longest`; returns whether there is memory. */
static int list_items(struct scene *scene, double longest) {
    count n = 0, levels = 2, most = 1 + scene->capsules * (scene->shapes + 1) + scene->pairs + scene->rooms;
    for (; longest > scene->spacing && levels < 64; levels++) longest *= 0.5;
    struct item *items = scene->item = malloc((levels + 1) * most * sizeof *items);
    if (!items) return 0;
    items[n++] = (struct item){FROM_WALLS, (int)scene->capsules - 1, 0};
    for (int k = 0; k < scene->rooms; k++) items[n++] = (struct item){IN_ROOM, (int)scene->capsules - 1, k};
    for (int i = 0; i < scene->capsules; i++) {
        in row = scene->capsule + CAPSULE * i;
        if (row[14] > 0.0) items[n++] = (struct item){FROM_FLOOR, i, 0};
        for (int k = 0; k < scene->shapes && row[15] > 0.0; k++)
            if (scene->touching[k * scene->capsules + i] == 0.0) items[n++] = (struct item){FROM_SHAPE, i, k};
    }
    for (int i = 0; i < scene->pairs; i++) items[n++] = (struct item){OF_PAIR, (int)scene->pair[PAIR * i], i};
    scene->items = n;
    return 1;
}

/* The arguments of the functions below as a scene. */
#define SCENE                                                                                                      \
    {chain, capsules, capsule,    pairs,      pair,       shapes,     shape,      bounds, touching,                \
     rooms, room,     ends,       numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], 0, 0, 0}

/* Whether straight pieces from postures (n, 6) to others are clear (n,): 1 or 0. */
void pieces_clear(in chain, count capsules, in capsule, count pairs, in pair, count shapes, in shape, in bounds,
                  in touching, count rooms, in room, in ends, in numbers, count n, in from, in to, double *out) {
    struct scene scene = SCENE;
    double longest = 0.0;
    for (count i = 0; i < 6 * n; i++) longest = fmax(longest, fabs(to[i] - from[i]));
    int is_ready = list_items(&scene, longest);
    for (count i = 0; i < n; i++)
        out[i] = is_ready && is_clear(&scene, from + 6 * i, to + 6 * i, scene.items, scene.item);
    free(scene.item);
}

/* A tree: postures (most, 6), each with the index of its parent. */
struct tree {
    count size, most;
    double *q;
    count *parent;
};

/* Takes one step from the nearest posture of a tree towards another one. Returns the new one's index, -1 if it is not
   clear, or there is no room. */
static count grow(struct scene *scene, struct tree *tree, in towards, double step) {
    count near = 0;
    double least = INFINITY, longest = 0.0, *new = tree->q + 6 * tree->size;
    if (tree->size == tree->most) return -1;
    for (count i = 0; i < tree->size; i++) {
        double away = 0.0;
        for (int j = 0; j < 6; j++) away += (tree->q[6 * i + j] - towards[j]) * (tree->q[6 * i + j] - towards[j]);
        if (away < least) {
            least = away;
            near = i;
        }
    }
    in from = tree->q + 6 * near;
    for (int j = 0; j < 6; j++) longest = fmax(longest, fabs(towards[j] - from[j]));
    double share = longest > step ? step / longest : 1.0;
    for (int j = 0; j < 6; j++) new[j] = share < 1.0 ? from[j] + share * (towards[j] - from[j]) : towards[j];
    if (!is_clear(scene, from, new, scene->items, scene->item)) return -1;
    tree->parent[tree->size] = near;
    return tree->size++;
}

/* Grows two trees (2, most, 6) in turn, each towards the next of m random postures and the other towards what is new,
   until they meet, or `budget` postures were evaluated.
   State (6,): sizes of both, whose turn it is; where they met in each, or -1; budget left. */
void grow_trees(in chain, count capsules, in capsule, count pairs, in pair, count shapes, in shape, in bounds,
                in touching, count rooms, in room, in ends, in numbers, count m, in random, double step, count most,
                double *q, count *parent, count *state) {
    struct scene scene = SCENE;
    struct tree trees[2] = {{state[0], most, q, parent}, {state[1], most, q + 6 * most, parent + most}};
    count turn = state[2], budget = list_items(&scene, step) ? state[5] : 0;
    for (count i = 0; i < m && scene.looked < budget && state[3] < 0; i++, turn = 1 - turn) {
        struct tree *one = trees + turn, *other = trees + 1 - turn;
        count new = grow(&scene, one, random + 6 * i, step), met = -1;
        if (new < 0) continue;
        in goal = one->q + 6 * new;
        while ((met = grow(&scene, other, goal, step)) >= 0 && memcmp(other->q + 6 * met, goal, 6 * sizeof *goal)) {}
        if (met < 0) continue;
        state[3 + turn] = new;
        state[4 - turn] = met;
    }
    state[0] = trees[0].size;
    state[1] = trees[1].size;
    state[2] = turn;
    state[5] = budget - scene.looked;
    free(scene.item);
}
