/* The approaches of plain.c, whose contacts CVODE integrates, and finds their events as roots (SUNDIALS 7).
 * The functions of the library are declared here, because the wheel of scikit-sundae has no headers. */
#define approaches approaches_plain
#include "plain.c"
#undef approaches

typedef void *Handle;
typedef int (*Rates)(double, Handle, Handle, void *);
typedef int (*Roots)(double, Handle, double *, void *);
int SUNContext_Create(int, Handle *), CVodeInit(Handle, Rates, double, Handle), CVodeReInit(Handle, double, Handle);
int CVodeSVtolerances(Handle, double, Handle), CVodeSetUserData(Handle, void *), CVodeRootInit(Handle, int, Roots);
int CVodeSetRootDirection(Handle, int *), CVodeSetNonlinearSolver(Handle, Handle), CVodeSetMaxNumSteps(Handle, long);
int CVode(Handle, double, Handle, double *, int), CVodeGetRootInfo(Handle, int *);
Handle N_VMake_Serial(int, double *, Handle), CVodeCreate(int, Handle), SUNNonlinSol_FixedPoint(Handle, int, Handle);
double *N_VGetArrayPointer(Handle);
void CVodeFree(Handle *), N_VDestroy(Handle);
int SUNNonlinSolFree(Handle), SUNContext_Free(Handle *);

enum { OVER, END, ALARM, EVENTS };
typedef struct { Law law; double until, alarm; } Contact;

static int derivatives(double t, Handle y, Handle r, void *of) {
    Law *l = &((Contact *)of)->law;
    const double *q = N_VGetArrayPointer(y);
    (void)t, l->held = 1.0 + l->d * q[W] > 0.0;  /* the contact does not pull */
    rates(l, q, N_VGetArrayPointer(r));
    return 0;
}
static int gauges(double t, Handle y, double *g, void *of) {
    const Contact *c = of;
    const double *q = N_VGetArrayPointer(y);
    (void)t;
    g[OVER] = q[Z], g[END] = q[T] - c->until, g[ALARM] = force(&c->law, q) - c->alarm;
    return 0;
}
/* As in plain.c, at the relative tolerance rtol, without an order; a scene in which CVODE fails has the velocity nan. */
void approaches(const Scene *c, long count, double rtol, int order, int points, double near, double *v, long *contacts) {
    (void)order;
    double q[N] = {0.0}, atol[N] = {rtol, rtol, rtol, rtol, rtol}, at;
    int directions[EVENTS] = {-1, 1, 1}, found[EVENTS];
    Handle context;
    SUNContext_Create(0, &context);
    Handle y = N_VMake_Serial(N, q, context), tolerances = N_VMake_Serial(N, atol, context);
    Handle cvode = CVodeCreate(1, context);
    Handle solver = SUNNonlinSol_FixedPoint(y, 0, context);  /* for Adams' methods: nothing is stiff here */
    Contact now;
    CVodeInit(cvode, derivatives, 0.0, y), CVodeSVtolerances(cvode, rtol, tolerances), CVodeSetUserData(cvode, &now);
    CVodeSetNonlinearSolver(cvode, solver), CVodeSetMaxNumSteps(cvode, 100000);
    CVodeRootInit(cvode, EVENTS, gauges), CVodeSetRootDirection(cvode, directions);
    for (long i = 0; i < count; i++) {
        State s = {.g = -c[i].distance, .brake = INFINITY};
        while (flight(&c[i], &s, points, near)) {
            double begin = s.t;
            int over = 0;
            now.law = law_of(&c[i], &s), now.alarm = s.detected ? INFINITY : c[i].threshold / now.law.f0;
            s.contacts++, q[Z] = 0.0, q[W] = 1.0, q[Y] = s.y, q[YD] = s.yd, q[T] = 0.0;
            atol[Y] = rtol * now.law.length, atol[YD] = rtol * now.law.speed, atol[T] = rtol * now.law.t0;
            while (!over && s.t < c[i].duration - 1e-15) {
                double until;
                now.law.a = commanded(&c[i], &s, &until), now.until = until - begin;
                for (int ends = CVodeReInit(cvode, 0.0, y); !ends && !over;) {
                    if (CVode(cvode, 1e6, y, &at, 1) != 2) { s.t = c[i].duration, q[W] = NAN; break; }
                    CVodeGetRootInfo(cvode, found), over = found[OVER], ends = found[END];
                    if (found[ALARM]) {
                        s.detected = 1, s.brake = begin + q[T] + c[i].delay, now.alarm = INFINITY;
                        now.until = fmin(now.until, s.brake - begin);
                    }
                    if (ends || over) move_flange(&c[i], &s, now.law.a, begin + q[T], ends);
                }
            }
            s.y = q[Y], s.yd = q[YD], s.gd = q[W] * now.law.speed, s.g = over ? 0.0 : q[Z] * q[Z] * now.law.length;
        }
        v[i] = s.v + s.yd - s.gd, contacts[i] = s.contacts;
    }
    CVodeFree(&cvode), SUNNonlinSolFree(solver), N_VDestroy(y), N_VDestroy(tolerances), SUNContext_Free(&context);
}
