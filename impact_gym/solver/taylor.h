/* The Taylor series of a contact with m = n = 3/2 and a tool that is fixed or on one spring and damper.

Its scaled equations (`physics/contact.pxi`) are sums of products of z, w, y and v. So the coefficients of order k + 1
follow from those up to order k by five Cauchy products: z y, z v, z^2, z^4 and z^4 w. See Jorba and
Zou, A software package for the numerical integration of ODEs by means of high-order Taylor methods (Experimental
Mathematics 14, 2005).

This file is C because Cython has neither pairs of numbers in one register (here products with a common factor) nor
unrolled loops. In each sum the term of the highest order is added last, so that the other terms are summed before this
order is known. */

typedef double Pair __attribute__((vector_size(16)));
typedef double Stored __attribute__((vector_size(16), aligned(8), may_alias));

enum {
    ORDER = 12, /* highest order of the series */
    COMPONENTS = 8 /* number of components: z, w, time, impulse, y, v, integral of y, and one that stays zero */
};

typedef struct {
    double active, damping; /* ' is d/ds; impulse' = z^4 (active + damping w) */
    double share, ground; /* w' = pull + ground z - share impulse' */
    double tool_share, push; /* v' = pull - push z - tool_share impulse' */
    double pull_y, pull_y_dot; /* pull = z (pull_y y + pull_y_dot v) */
} Polynomial;

static void expand_polynomial(const Polynomial *given, const double *x, double (*series)[COMPONENTS])
{
    const Polynomial equations = *given;
    const double twice_z = 2.0 * x[0], twice_a = twice_z * x[0];
    const double stiffening = equations.active + equations.damping * x[1];
    Pair zw[ORDER + 1], yv[ORDER + 1]; /* pairs of coefficients: z and w, y and v */
    Pair zz[ORDER], zb[ORDER]; /* pairs of coefficients: z and z, z and b = z^4 */
    double a[ORDER]; /* coefficients of z^2 */
    zw[0] = (Pair){x[0], x[1]};
    yv[0] = (Pair){x[4], x[5]};
    for (int i = 0; i < COMPONENTS; i++)
        series[0][i] = i < COMPONENTS - 1 ? x[i] : 0.0;
#pragma GCC unroll 16
    for (int k = 0; k < ORDER; k++) {
        const double part = 1.0 / (k + 1), z = zw[k][0], w = zw[k][1];
        Pair of_z = {0.0, 0.0}, of_b = {0.0, 0.0}; /* for z y and z v, for z^2 and b w, without first and last terms */
        double of_a = 0.0, b, impulse, pull;
        if (k % 2 == 0 && k > 0) {
            of_z = zz[k / 2] * yv[k / 2];
            of_b = zb[k / 2] * zw[k / 2];
        }
#pragma GCC unroll 16
        for (int i = (k - 1) / 2; i > 0; i--) {
            of_z += zz[i] * yv[k - i];
            of_z += zz[k - i] * yv[i];
            of_b += zb[i] * zw[k - i];
            of_b += zb[k - i] * zw[i];
            of_a += a[i] * a[k - i];
        }
        zz[k] = (Pair){z, z};
        if (k == 0) {
            a[0] = z * z;
            b = a[0] * a[0];
            of_z = zz[0] * yv[0];
            impulse = stiffening * b;
        } else {
            a[k] = of_b[0] + twice_z * z;
            of_a *= 2.0;
            if (k % 2 == 0)
                of_a += a[k / 2] * a[k / 2];
            b = of_a + twice_a * a[k];
            of_z = (of_z + zz[k] * yv[0]) + zz[0] * yv[k];
            impulse = (equations.damping * of_b[1] + stiffening * b) + (equations.damping * zb[0][1]) * w;
        }
        zb[k] = (Pair){z, b};
        pull = equations.pull_y * of_z[0] + equations.pull_y_dot * of_z[1];
        zw[k + 1] = (Pair){0.5 * part * w, part * (pull + equations.ground * z) - part * equations.share * impulse};
        yv[k + 1] = (Pair){part * of_z[1], part * (pull - equations.push * z) - part * equations.tool_share * impulse};
        *(Stored *) &series[k + 1][0] = zw[k + 1];
        *(Stored *) &series[k + 1][2] = (Pair){part * z, part * impulse};
        *(Stored *) &series[k + 1][4] = yv[k + 1];
        *(Stored *) &series[k + 1][6] = (Pair){part * of_z[0], 0.0};
    }
}
