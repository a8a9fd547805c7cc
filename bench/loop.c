/*
 * The closed loop of bench/simulate.py written by hand for this one case: what is left to gain.
 *
 * The plant of the paper, a nested observer of two levels with the gains of a constant time step,
 * the linear law, the magnitude limit, Runge-Kutta of order 4, the figures of merit and the signals
 * of each period. Without the fault policy and without looking for what is not finite; the slope at
 * the start of a period is evaluated twice, for the truth and for the step, ours once.
 */
#include <math.h>

enum { N = 3, K = 2, COLUMNS = 9 + K };
enum { ITAE, ISU, IAE, ISE, ITSE, MAX_ERROR, PEAK_ERROR, VARIATION, SATURATED, DURATION };

typedef struct {
    double rate, settle_time;
    double a1, a2, a3, b0;    /* plant; b0 is also the controller's */
    double frequency;         /* of the reference cos(frequency t) */
    double decay, pulsation;  /* of the disturbance exp(-decay t) cos(pulsation t) */
    double k0, k1;            /* feedback gains */
    double fading;            /* of the offset of a bumpless start, in one period */
    double low, high;         /* limits of the command */
    double gains[K][N];       /* of the current observers */
} Loop;

static double disturbance(const Loop *p, double t)
{
    return exp(-p->decay * t) * cos(p->pulsation * t);
}

static void derivative(const Loop *p, double t, const double *x, double u, double w, double *dx)
{
    dx[0] = x[1];
    dx[1] = p->a1 * x[0] + p->a2 * sin(x[1]) + w + (1.0 + p->a3 * sin(t)) * u;
}

static void integrate(const Loop *p, double t, double *x, double u, double h, int substeps)
{
    double step = h / substeps, s1[2], s2[2], s3[2], s4[2], stage[2];
    for (int j = 0; j < substeps; j++) {
        double start = t + j * step, middle = start + 0.5 * step, end = t + (j + 1) * step;
        double w = disturbance(p, middle);
        derivative(p, start, x, u, disturbance(p, start), s1);
        for (int i = 0; i < 2; i++)
            stage[i] = x[i] + 0.5 * step * s1[i];
        derivative(p, middle, stage, u, w, s2);
        for (int i = 0; i < 2; i++)
            stage[i] = x[i] + 0.5 * step * s2[i];
        derivative(p, middle, stage, u, w, s3);
        for (int i = 0; i < 2; i++)
            stage[i] = x[i] + step * s3[i];
        derivative(p, end, stage, u, disturbance(p, end), s4);
        for (int i = 0; i < 2; i++)
            x[i] += step / 6.0 * (s1[i] + 2.0 * (s2[i] + s3[i]) + s4[i]);
    }
}

static void observe(const Loop *p, double z[K][N], double y, double u, double h)
{
    double received = p->b0 * u, inner = z[0][2];
    for (int k = 0; k < K; k++) {
        double v = k ? received + inner : received;
        double rate = z[k][2] + v;
        double ahead = z[k][0] + h * (z[k][1] + 0.5 * h * rate), innovation = y - ahead;
        z[k][0] = ahead + p->gains[k][0] * innovation;
        z[k][1] += h * rate + p->gains[k][1] * innovation;
        z[k][2] += p->gains[k][2] * innovation;
    }
}

/* Run `steps` periods from x on; sums has an entry for each of the above, left one for each level,
   rows COLUMNS for each period. */
void run(const Loop *p, int steps, int substeps, const double *noise, double *x, double *sums,
         double *left, double *rows)
{
    double z[K][N] = {{0.0}}, h = 1.0 / p->rate, u = 0.0, offset = 0.0;
    for (int k = 0; k < steps; k++) {
        double t = k / p->rate, angle = p->frequency * t;
        double r = cos(angle), rate = -p->frequency * sin(angle);
        double acceleration = -p->frequency * p->frequency * r;
        double y = x[0], measured = y + noise[k], before = u;
        if (k == 0)
            z[0][0] = z[1][0] = measured;
        observe(p, z, measured, u, h);
        double v = acceleration + p->k0 * (r - z[0][0]) + p->k1 * (rate - z[0][1]);
        double raw = (v - z[1][2] - z[0][2]) / p->b0;
        if (k == 0) { /* bumpless: the first command is the one before */
            offset = u - raw;
        } else {
            offset *= p->fading;
            raw += offset;
            u = raw > p->high ? p->high : raw < p->low ? p->low : raw;
            if ((raw - u) * offset > 0.0)
                offset -= copysign(fmin(fabs(raw - u), fabs(offset)), offset);
        }
        double dx[2];
        derivative(p, t, x, u, disturbance(p, t), dx);
        double truth = dx[1] - p->b0 * u, size = fabs(r - y), remainder = truth;
        integrate(p, t, x, u, h, substeps);

        sums[ITAE] += h * t * size;
        sums[ISU] += h * (u * u);
        sums[IAE] += h * size;
        sums[ISE] += h * (size * size);
        sums[ITSE] += h * t * (size * size);
        if (k)
            sums[VARIATION] += fabs(u - before);
        sums[DURATION] += h;
        if (u <= p->low || u >= p->high)
            sums[SATURATED] += h;
        if (size > sums[MAX_ERROR])
            sums[MAX_ERROR] = size;
        if (t >= p->settle_time && size > sums[PEAK_ERROR])
            sums[PEAK_ERROR] = size;
        for (int j = 0; j < K; j++) {
            remainder -= z[j][2];
            left[j] += h * t * fabs(remainder);
        }
        double *row = rows + (long)COLUMNS * k;
        row[0] = t;
        row[1] = r;
        row[2] = r;
        row[3] = y;
        row[4] = measured;
        row[5] = u;
        row[6] = z[0][0];
        row[7] = z[0][2] + z[1][2];
        row[8] = truth;
        row[9] = z[0][2];
        row[10] = z[1][2];
    }
}
