/* The Taylor series of a contact with m = n = 3/2 and a tool that is fixed or on one spring and damper.

Its scaled equations (`physics/contact.pxi`) are sums of products of z, w, y and v. So the coefficients of order k + 1
follow from those up to order k by five Cauchy products: z y, z v, z^2, z^4 and z^4 w. See Jorba and
Zou, A software package for the numerical integration of ODEs by means of high-order Taylor methods (Experimental
Mathematics 14, 2005).

This file is C because Cython has neither pairs of numbers in one register (here products with a common factor) nor
unrolled loops. In each sum the term of the highest order is added last, so that the other terms are summed before this
order is known. */

typedef double Pair __attribute__((vector_size(16)));
typedef double Quad __attribute__((vector_size(32)));
typedef double Stored __attribute__((vector_size(16), aligned(8), may_alias));

#if defined(__x86_64__) && defined(__gnu_linux__)
#define FOR_AVX2_TOO __attribute__((target_clones("avx2", "default"))) /* chosen when the module loads; equal results */
#else
#define FOR_AVX2_TOO
#endif

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

FOR_AVX2_TOO
static void expand_polynomial(const Polynomial *given, const double *x, double (*series)[COMPONENTS])
{
    const Polynomial equations = *given;
    const double twice_z = 2.0 * x[0], twice_a = twice_z * x[0];
    const double stiffening = equations.active + equations.damping * x[1];
    Quad of[ORDER + 1], by[ORDER]; /* coefficients of z, w, y, v; and of their factors z, b = z^4, z, z */
    double a[ORDER]; /* coefficients of z^2 */
    of[0] = (Quad){x[0], x[1], x[4], x[5]};
    for (int i = 0; i < COMPONENTS; i++)
        series[0][i] = i < COMPONENTS - 1 ? x[i] : 0.0;
#pragma GCC unroll 16
    for (int k = 0; k < ORDER; k++) {
        const double part = 1.0 / (k + 1), z = of[k][0], w = of[k][1];
        Quad sum = {0.0, 0.0, 0.0, 0.0}; /* for z^2, b w, z y and z v, without first and last terms */
        double of_a = 0.0, of_y, of_v, b, impulse, pull;
        if (k % 2 == 0 && k > 0)
            sum = by[k / 2] * of[k / 2];
#pragma GCC unroll 16
        for (int i = (k - 1) / 2; i > 0; i--) {
            sum += by[i] * of[k - i];
            sum += by[k - i] * of[i];
            of_a += a[i] * a[k - i];
        }
        of_a *= 2.0;
        if (k % 2 == 0 && k > 0)
            of_a += a[k / 2] * a[k / 2];
        a[k] = k ? sum[0] + twice_z * z : z * z;
        b = k ? of_a + twice_a * a[k] : a[0] * a[0];
        of_y = k ? (sum[2] + z * of[0][2]) + of[0][0] * of[k][2] : z * of[0][2];
        of_v = k ? (sum[3] + z * of[0][3]) + of[0][0] * of[k][3] : z * of[0][3];
        impulse = (equations.damping * sum[1] + stiffening * b) + (k ? equations.damping * by[0][1] * w : 0.0);
        by[k] = (Quad){z, b, z, z};
        pull = equations.pull_y * of_y + equations.pull_y_dot * of_v;
        of[k + 1] = (Quad){
            0.5 * part * w, part * (pull + equations.ground * z) - part * equations.share * impulse,
            part * of_v, part * (pull - equations.push * z) - part * equations.tool_share * impulse,
        };
        *(Stored *) &series[k + 1][0] = (Pair){of[k + 1][0], of[k + 1][1]};
        *(Stored *) &series[k + 1][2] = (Pair){part * z, part * impulse};
        *(Stored *) &series[k + 1][4] = (Pair){of[k + 1][2], of[k + 1][3]};
        *(Stored *) &series[k + 1][6] = (Pair){part * of_y, 0.0};
    }
}
