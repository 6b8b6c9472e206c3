/* A plain program for approaches: flight in closed form, Runge-Kutta of fixed steps in a smooth variable.
 * A tool on a critically damped spring is moved by a trapezoid with a brake and strikes an object (paper, eq. 5 and 7).
 * In natural units of a contact, with penetration z^2, its rate w, dt = z ds, and the damping factor d of Hu and Guo:
 * z' = w / 2,  w' = z (push - z^3 (1 + d w)).  A flight is searched for a touch at a few points only. Else SI. */
#include <math.h>

enum { Z, W, Y, YD, T, N, FORCE = N };  /* in a contact: z, w, the tool's way and velocity beside the flange, time */
typedef struct { double tool_mass, spring, object_mass, distance, stiffness, restitution;
                 double speed, acceleration, threshold, delay, deceleration, duration; } Scene;
/* x, v: flange; y, yd: tool beside the flange; g, gd: penetration; brake: time of its start */
typedef struct { double t, x, v, y, yd, g, gd, brake; int braking, detected, contacts; } State;
typedef struct { double w2, c, a, d, length, speed, t0, f0, push, inv_tool, held; } Law;

static Law law_of(const Scene *c, const State *s) {
    double mass = c->object_mass * c->tool_mass / (c->object_mass + c->tool_mass), v = s->gd;
    double w2 = c->spring / c->tool_mass, length = pow(mass * v * v / c->stiffness, 0.4);
    return (Law){w2, 2.0 * sqrt(w2), 0.0, 1.5 * (1.0 - c->restitution) / c->restitution, length, v, length / v,
                 mass * v * v / length, length / (v * v), 1.0 / c->tool_mass, 1.0};
}
static inline double force(const Law *l, const double *q) { return q[Z] * q[Z] * q[Z] * (1.0 + l->d * q[W]); }
static inline void rates(const Law *l, const double *q, double *r) {
    double f = l->held * force(l, q), dt = q[Z] * l->t0, pull = l->w2 * q[Y] + l->c * q[YD];
    r[Z] = 0.5 * q[W], r[W] = q[Z] * (-pull * l->push - f), r[Y] = dt * q[YD], r[T] = dt;
    r[YD] = -dt * (l->a + pull + f * l->f0 * l->inv_tool);
}
#define STAGE(to, ...) do { const double A[] = {__VA_ARGS__}; \
    for (int i = 0; i < N; i++) { double sum = 0.0; \
        for (unsigned j = 0; j < sizeof A / sizeof *A; j++) if (A[j] != 0.0) sum += A[j] * k[j][i]; \
        p[i] = q[i] + h * sum; \
    } if (to) rates(l, p, k[to]); } while (0)
/* A step of length h from q, whose rates are `first`, to p. */
static inline void step(const Law *l, int order, const double *q, const double *first, double h, double *p) {
    double k[11][N], s = 4.58257569495584;  /* sqrt(21) */
    for (int i = 0; i < N; i++) k[0][i] = first[i];
    if (order == 4) {
        STAGE(1, 0.5); STAGE(2, 0, 0.5); STAGE(3, 0, 0, 1.0); STAGE(0, 1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6);
    } else if (order == 6) {  /* Butcher's method */
        STAGE(1, 1.0 / 3); STAGE(2, 0, 2.0 / 3); STAGE(3, 1.0 / 12, 1.0 / 3, -1.0 / 12);
        STAGE(4, -1.0 / 16, 9.0 / 8, -3.0 / 16, -3.0 / 8); STAGE(5, 0, 9.0 / 8, -3.0 / 8, -3.0 / 4, 0.5);
        STAGE(6, 9.0 / 44, -9.0 / 11, 63.0 / 44, 18.0 / 11, 0, -16.0 / 11);
        STAGE(0, 11.0 / 120, 0, 27.0 / 40, 27.0 / 40, -4.0 / 15, -4.0 / 15, 11.0 / 120);
    } else {  /* order 8, Cooper and Verner's method */
        STAGE(1, 0.5); STAGE(2, 0.25, 0.25); STAGE(3, 1.0 / 7, (-7 - 3 * s) / 98, (21 + 5 * s) / 49);
        STAGE(4, (11 + s) / 84, 0, (18 + 4 * s) / 63, (21 - s) / 252);
        STAGE(5, (5 + s) / 48, 0, (9 + s) / 36, (-231 + 14 * s) / 360, (63 - 7 * s) / 80);
        STAGE(6, (10 - s) / 42, 0, (92 * s - 432) / 315, (633 - 145 * s) / 90, (115 * s - 504) / 70, 1.8 - 13 * s / 35);
        STAGE(7, 1.0 / 14, 0, 0, 0, (14 - 3 * s) / 126, (13 - 3 * s) / 63, 1.0 / 9);
        STAGE(8, 1.0 / 32, 0, 0, 0, (91 - 21 * s) / 576, 11.0 / 72, (-385 - 75 * s) / 1152, (63 + 13 * s) / 128);
        STAGE(9, 1.0 / 14, 0, 0, 0, 1.0 / 9, (-733 - 147 * s) / 2205, (515 + 111 * s) / 504, (-51 - 11 * s) / 56,
              (132 + 28 * s) / 245); STAGE(10, 0, 0, 0, 0, (7 * s - 42) / 18, (28 * s - 18) / 45,
              (-273 - 53 * s) / 72, (301 + 53 * s) / 72, (28 - 28 * s) / 45, (49 - 7 * s) / 18);
        STAGE(0, 1.0 / 20, 0, 0, 0, 0, 0, 0, 49.0 / 180, 16.0 / 45, 49.0 / 180, 1.0 / 20);
    }
}
/* Return the commanded acceleration, and until when it lasts. */
static double commanded(const Scene *c, const State *s, double *until) {
    double a = s->braking ? (s->v > 0.0 ? -c->deceleration : 0.0) : s->v < c->speed ? c->acceleration : 0.0;
    *until = fmin(fmin(s->brake, c->duration), a == 0.0 ? INFINITY : s->t + ((a > 0.0) * c->speed - s->v) / a);
    return a;
}
/* Move the flange to the time t. `ends`: t is an end of the acceleration. */
static inline void move_flange(const Scene *c, State *s, double a, double t, int ends) {
    double dt = t - s->t, goal = a > 0.0 ? c->speed : 0.0;
    s->x += dt * (s->v + 0.5 * a * dt), s->v += a * dt, s->t = t;
    if (ends && a != 0.0 && fabs(s->v - goal) < 1e-9) s->v = goal;
    if (ends && t >= s->brake - 1e-15) s->braking = 1, s->brake = INFINITY;
}
/* Find p within the step h from q, where a row of the state or FORCE equals `target`; return the length up to there. */
static double land(const Law *l, int order, const double *q, const double *k, double h, int what, double target,
                   double near, double *p) {
    int sign = (what == FORCE ? force(l, p) : p[what]) > target;
    double low = 0.0, high = h, r[N], before, guess = what != Z ? 0.5 * h : q[Z] > 0.0 ? h * q[Z] / (q[Z] - p[Z]) : h;
    for (int i = 0; i < 30; i++) {
        step(l, order, q, k, before = guess, p), rates(l, p, r);
        double miss = (what == FORCE ? force(l, p) : p[what]) - target, slope = r[what % N];
        if (what == FORCE) slope = p[Z] * p[Z] * (3.0 * r[Z] * (1.0 + l->d * p[W]) + p[Z] * l->d * r[W]);
        if ((miss > 0.0) == sign) high = guess; else low = guess;
        guess -= miss / slope;
        if (!(guess > low && guess < high)) guess = 0.5 * (low + high);
        if (fabs(guess - before) < near * h) break;  /* one more step of Newton's method squares this error */
    }
    step(l, order, q, k, guess, p);
    return guess;
}
static void contact(const Scene *c, State *s, double length, int order, double near) {
    Law l = law_of(c, s);
    double q[N] = {0.0, 1.0, s->y, s->yd, 0.0}, p[N], k[N], at[N], until, begin = s->t, alarm = c->threshold / l.f0;
    int over = 0;
    for (s->contacts++; !over && s->t < c->duration - 1e-15;) {
        l.a = commanded(c, s, &until);
        for (int ends = 0; !ends && !over;) {
            double h = length;
            rates(&l, q, k), step(&l, order, q, k, h, p);
            if (!(fabs(p[W]) < 100.0)) { s->t = c->duration, s->gd = NAN; return; }  /* h is too long */
            if ((over = p[Z] <= 0.0)) h = land(&l, order, q, k, h, Z, 0.0, near, p);
            if ((ends = p[T] >= until - begin)) land(&l, order, q, k, h, T, until - begin, near, p), over = 0;
            if (!l.held && 1.0 + l.d * p[W] > 0.0) l.held = 1.0;
            else if (l.held && p[Z] > 0.0 && !ends && force(&l, p) < 0.0 && 1.0 + l.d * q[W] > 0.0)  /* it would pull */
                land(&l, order, q, k, h, FORCE, 0.0, near, p), l.held = over = 0;
            if (!s->detected && force(&l, p) >= alarm) {
                for (int i = 0; i < N; i++) at[i] = p[i];
                land(&l, order, q, k, h, FORCE, alarm, near, at);
                s->detected = 1, s->brake = begin + at[T] + c->delay, until = fmin(until, s->brake);
            }
            for (int i = 0; i < N; i++) q[i] = p[i];
            if (ends || over) move_flange(c, s, l.a, begin + q[T], ends);
        }
    }
    s->y = q[Y], s->yd = q[YD], s->gd = q[W] * l.speed, s->g = over ? 0.0 : q[Z] * q[Z] * l.length;
}
/* Return the state after dt of flight; w: natural frequency of the spring, object: velocity of the object. */
static State drift(const Scene *c, const State *s, double w, double a, double object, double dt) {
    double rest = a / (w * w), z = s->y + rest, b = s->yd + w * z, fade = exp(-w * dt);
    State e = *s;
    move_flange(c, &e, a, s->t + dt, 0);
    e.y = fade * (z + b * dt) - rest, e.yd = fade * (s->yd - w * b * dt);
    e.g = s->g + (e.x + e.y - s->x - s->y) - object * dt, e.gd = e.v + e.yd - object;
    return e;
}
/* Fly to a touch (1) or to the end (0). */
static int flight(const Scene *c, State *s, int points, double near) {
    double w = sqrt(c->spring / c->tool_mass), object = s->v + s->yd - s->gd, until;
    while (s->t < c->duration - 1e-15) {
        double a = commanded(c, s, &until), span = until - s->t, low = 0.0, high = 0.0;
        if (a == 0.0 && s->v == 0.0 && object * object >= s->yd * s->yd + w * w * s->y * s->y) return 0;  /* too slow */
        State e = *s;
        for (int i = 1; i <= points && !(e.g > 0.0); i++)
            low = high, high = span * i / points, e = drift(c, s, w, a, object, high);
        int met = e.g > 0.0, close = !met;
        for (double guess = high; !close;) {
            double change = e.g / e.gd;
            if (e.g > 0.0) high = guess; else low = guess;
            close = fabs(change) < near * high || high - low < 1e-16, guess -= change;
            if (!close && !(guess > low && guess < high)) guess = 0.5 * (low + high);
            e = drift(c, s, w, a, object, guess);
        }
        *s = e;
        if (met) return s->g = 0.0, s->gd > 0.0;
        move_flange(c, s, a, until, 1);
    }
    return 0;
}
/* Velocity of the object at the end (m/s) and number of contacts of each scene, with steps of length h (natural). */
void approaches(const Scene *c, long count, double h, int order, int points, double near, double *v, long *contacts) {
    for (long i = 0; i < count; i++) {
        State s = {.g = -c[i].distance, .brake = INFINITY};
        while (flight(&c[i], &s, points, near)) contact(&c[i], &s, h, order, near);
        v[i] = s.v + s.yd - s.gd, contacts[i] = s.contacts;
    }
}
